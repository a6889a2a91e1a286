//! `[matching]`: the force- or EMG-matching experiment of the appendix.
//!
//! The subject keeps a rhythm against a spring, then is guided through the same movement, in turn.
//! A bar shows how the effort compares with that of the session before, which it is to match. The
//! section takes the place of `[[segments]]`: what is played follows from it and from the rig,
//! whose corner the centre is counted from.

use emg::Group;
use ipc_types::Mode;

use super::field::Field;
use super::maxima::check_electrodes;
use super::movement::{Centre, GuidedSine, Movement, Rest, Rhythm, WaitForScanner};
use super::segment::Segment;
use super::sines::{Envelope, Line};
use crate::axis::Axis;
use crate::axis_unit::AxisUnit;
use crate::checked_toml::{Bounds, Keys, Section, Source, bounds};
use crate::rig_file::RigFile;

/// A force- or EMG-matching experiment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Matching {
    /// What the bar shows.
    pub signal: Signal,
    /// Each set is a session of rhythm and a guided one.
    pub sets: u32,
    /// Duration of a session (s).
    pub session_s: f64,
    /// Rest between two sessions (s).
    pub rest_s: f64,
    /// Time from the scanner's first pulse to the first session (s).
    pub start_up_s: f64,
    /// The protocol ends if that pulse has not come by then (s).
    pub timeout_s: f64,
    /// Time to bring the handle to the centre after each session (s).
    pub centring_s: f64,
    /// Time of the guided movement's blend from rest, and to rest (s).
    pub fade_s: f64,
    /// The axis that moves.
    pub axis: usize,
    /// Centre of both movements, from the axis's corner (rad).
    pub centre: f64,
    /// Frequency of both movements (Hz).
    pub frequency_hz: f64,
    /// Amplitude of both movements, to either side of the centre (rad).
    pub amplitude: f64,
    /// Stiffness of the spring in the sessions of rhythm (N·m/rad).
    pub spring: f64,
}

/// What a subject has to match.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Signal {
    /// The mean magnitude of the torque at the handle; one bar.
    Torque,
    /// The activity of the agonist and of the antagonist muscles; a bar for each.
    Emg,
}

pub(super) const KEYS: Keys = &[
    ("signal", "What the subject matches: one bar for torque, two for agonists and antagonists."),
    ("sets", "Number of sets: each is a session of rhythm and a guided one."),
    ("session_s", "Duration of a session."),
    ("rest_s", "Time from the end of centring to the next session, at 0 V."),
    ("start_up_s", "Time from the scanner's first pulse to the first session."),
    ("timeout_s", "The protocol ends if that pulse has not come by then."),
    ("centre_deg", "Centre of both movements, from the corner: the rig's lower stop."),
    ("frequency_hz", "Frequency of both movements."),
    ("amplitude_deg", "Amplitude of both movements, to either side of the centre."),
    ("spring", "Stiffness of the spring in the sessions of rhythm, in N·m/rad."),
    ("axis", "Index of the rig's axis that moves, from 0."),
    ("centring_s", "Time to bring the handle to the centre after each session."),
    ("fade_s", "Time of the guided movement's blend from rest, and to rest; part of the session."),
];

const SESSION: Bounds = bounds(5.0, 600.0, "in s; the appendix asks for 5 s at least");
const REST: Bounds = bounds(10.0, 3600.0, "in s; the appendix asks for 10 s at least");
const START_UP: Bounds = bounds(10.0, 600.0, "in s; the appendix asks for 10 s at least");
const TIMEOUT: Bounds = bounds(1.0, 3600.0, "in s; long enough to start the scanner");
const CENTRE: Bounds = bounds(70.0, 130.0, "in degrees from the corner (appendix)");
const FREQUENCY: Bounds = bounds(0.2, 3.0, "in Hz (appendix)");
const AMPLITUDE: Bounds = bounds(0.0, 40.0, "in degrees (appendix)");
const SPRING: Bounds = bounds(0.1, 2.0, "in N·m/rad (appendix; its unit is not printed)");
const CENTRING: Bounds = bounds(1.0, 60.0, "in s; slow enough for a hand that holds the handle");
const FADE: Bounds = bounds(0.1, 10.0, "in s");

impl Signal {
    const WORDS: &'static [(&'static str, Self)] = &[("torque", Self::Torque), ("emg", Self::Emg)];

    /// The word in the file.
    pub const fn word(self) -> &'static str {
        match self {
            Self::Torque => "torque",
            Self::Emg => "emg",
        }
    }
}

impl Matching {
    /// Reads the section; `None` where it is not in the file.
    pub(super) fn read(section: Section<'_>) -> Option<Self> {
        section.document("[matching]", KEYS);
        if !section.exists() {
            return None;
        }
        let session_s = section.number("session_s", SESSION);
        let fade_s = section.number_or("fade_s", 1.0, FADE);
        if 2.0 * fade_s > session_s {
            let expected = format!("at most half of session_s ({} s)", session_s / 2.0);
            section.problem("fade_s", expected, fade_s, "the fades are part of the session");
        }
        let sets = section.whole("sets", 1, 100, "each set has two sessions") as u32;
        let last = ipc_types::AXES as u64 - 1;
        Some(Self {
            signal: section.word("signal", Signal::WORDS).unwrap_or(Signal::Torque),
            sets,
            session_s,
            rest_s: section.number("rest_s", REST),
            start_up_s: section.number("start_up_s", START_UP),
            timeout_s: section.number_or("timeout_s", 300.0, TIMEOUT),
            centring_s: section.number_or("centring_s", 3.0, CENTRING),
            fade_s,
            axis: section.whole_or("axis", 0, 0, last, "index of the rig's axis, from 0") as usize,
            centre: section.number("centre_deg", CENTRE).to_radians(),
            frequency_hz: section.number("frequency_hz", FREQUENCY),
            amplitude: section.number("amplitude_deg", AMPLITUDE).to_radians(),
            spring: section.number("spring", SPRING),
        })
    }

    /// What is played, on an axis whose corner is at `corner` (rad): the wait for the scanner, then
    /// the sessions, a rhythm first, each followed by centring and, but for the last, by a rest.
    pub fn segments(&self, corner: f64) -> Vec<Segment> {
        let centre = corner + self.centre;
        let sessions = 2 * self.sets;
        let segment = |label: String, session, movement| Segment {
            label,
            session,
            axis: self.axis,
            unit: Some(AxisUnit::Radian),
            repeat: 1,
            movement,
            companions: Vec::new(),
            contraction: None,
            instruction: None,
            sound: None,
            section: "matching".to_owned(),
        };
        let wait =
            WaitForScanner { timeout_s: self.timeout_s, pulse: 1, start_up_s: self.start_up_s };
        let mut segments = vec![segment(
            "waiting for the scanner".to_owned(),
            false,
            Movement::WaitForScanner(wait),
        )];
        for number in 1..=sessions {
            let (kind, movement) = match number % 2 {
                1 => ("rhythm", Movement::Rhythm(self.rhythm(centre))),
                _ => ("guided", Movement::GuidedSine(self.guided(centre))),
            };
            segments.push(segment(
                format!("session {number} of {sessions}: {kind}"),
                true,
                movement,
            ));
            let centring = Movement::Centre(self.centring(centre));
            segments.push(segment(format!("centring {number}"), false, centring));
            if number < sessions {
                let rest = Movement::Rest(Rest { duration_s: self.rest_s });
                segments.push(segment(format!("rest {number}"), false, rest));
            }
        }
        segments
    }

    fn rhythm(&self, centre: f64) -> Rhythm {
        Rhythm {
            frequency_hz: self.frequency_hz,
            amplitude: self.amplitude,
            field: Field { stiffness: self.spring, centre, ..Field::default() },
            duration_s: self.session_s,
        }
    }

    const fn guided(&self, centre: f64) -> GuidedSine {
        GuidedSine {
            line: Line { amplitude: self.amplitude, frequency_hz: self.frequency_hz, phase: 0.0 },
            envelope: Envelope {
                centre,
                duration_s: self.session_s,
                fade_in_s: self.fade_s,
                fade_out_s: self.fade_s,
            },
        }
    }

    const fn centring(&self, centre: f64) -> Centre {
        Centre {
            position: Some(centre),
            // The rest of it is time to settle.
            rise_s: self.centring_s * 0.75,
            duration_s: self.centring_s,
            resting: Mode::Centre,
        }
    }

    /// Checks that the rig has what the subject matches; reports a problem where it has not.
    pub(super) fn check(&self, rig: &RigFile, source: &Source<'_>) {
        let Some(axis) = rig.axes.get(self.axis) else { return };
        if self.signal == Signal::Torque && axis.torque.is_none() {
            let expected = format!("a sensor of the hand's torque on axis \"{}\"", axis.name);
            let advice = "add [axes.torque] to the rig file";
            source.problem("matching.signal", expected, "none in the rig file", advice);
        }
        for group in Group::ALL.into_iter().filter(|_| self.signal == Signal::Emg) {
            check_electrodes(group, "matching.signal", rig, source);
        }
        let centre = corner(axis) + self.centre;
        let (least, most) = (centre - self.amplitude, centre + self.amplitude);
        if let Some(stops) = axis.stop_search()
            && (least < stops.lower || most > stops.upper)
        {
            let degrees = |position: f64| format!("{:.1}°", position.to_degrees());
            let (lower, upper) = (degrees(stops.lower), degrees(stops.upper));
            let expected = format!("positions between the stops ({lower} to {upper})");
            let found = format!("a movement from {} to {}", degrees(least), degrees(most));
            let advice = "move less, or about another centre; the stops are the rig file's";
            source.problem("matching.amplitude_deg", expected, found, advice);
        }
    }
}

/// Where the corner of an axis is, from its zero (rad or m): its lower stop, or its lower limit
/// where the rig file has no stops.
pub(super) fn corner(axis: &Axis) -> f64 {
    axis.stop_search().map_or(axis.limits.position_min, |search| search.lower)
}

//! The kinds of movement, their bounds, and how they stand in the file.

use std::f64::consts::TAU;

use super::excitation::{Chirp, Ramp};
use super::field::Field;
use super::learn::Learn;
use super::lengths::{
    AMPLITUDE_DEG, AMPLITUDE_M, DURATION, FADE, LINE_HZ, Lengths, POSITION_DEG, POSITION_M,
};
use super::modes::{Centre, Initialise, Rhythm};
use super::tabled::Tabled;
use crate::axis_unit::AxisUnit;
use crate::read::{Bounds, Section, bounds};

/// Peak speed of a minimum-jerk movement over distance and time: `15/8`, at half time.
/// Source: Flash and Hogan, J. Neuroscience 5(7), 1985.
pub const MIN_JERK_PEAK_SPEED: f64 = 1.875;

/// What a segment does. Positions are in rad or m, times in s.
///
/// Every movement begins where the one before ended, at rest, and ends at rest.
#[derive(Clone, Debug, PartialEq)]
pub enum Movement {
    /// A sine about a centre.
    GuidedSine {
        /// Amplitude (rad or m).
        amplitude: f64,
        /// Frequency (Hz).
        frequency_hz: f64,
        /// Whole duration, fades included (s).
        duration_s: f64,
        /// Centre (rad or m).
        centre: f64,
        /// Time from the position at the start into the full movement (s).
        fade_in_s: f64,
        /// Time from the full movement to rest at the centre (s).
        fade_out_s: f64,
    },
    /// A sum of sines about a centre.
    Multisine {
        /// Its lines.
        lines: Vec<Line>,
        /// Whole duration, fades included (s).
        duration_s: f64,
        /// Centre (rad or m).
        centre: f64,
        /// Time from the position at the start into the full movement (s).
        fade_in_s: f64,
        /// Time from the full movement to rest at the centre (s).
        fade_out_s: f64,
    },
    /// From position to position.
    Steps {
        /// Where to, in order (rad or m).
        positions: Vec<f64>,
        /// Rest at each (s).
        dwell_s: f64,
        /// Time of each movement, minimum jerk (s).
        rise_s: f64,
    },
    /// To a position, and rest there under power.
    Hold {
        /// Where; `None`: where the handle is (rad or m).
        position: Option<f64>,
        /// Time of the movement there, within the duration (s).
        rise_s: f64,
        /// Whole duration (s).
        duration_s: f64,
    },
    /// 0 V; the handle stays or is moved by hand.
    Rest {
        /// Duration (s).
        duration_s: f64,
    },
    /// The hand moves as it likes, the machine with it (§ 4.2), in a force field.
    Free {
        /// Duration (s).
        duration_s: f64,
        /// What the hand feels.
        field: Field,
    },
    /// Gently to the ends of the travel, to find them.
    Initialise(Initialise),
    /// To the middle of the experiment, and rest there under power.
    Centre(Centre),
    /// The hand keeps a rhythm in a spring field, the machine moves with it.
    Rhythm(Rhythm),
    /// To a position at constant speed.
    Ramp(Ramp),
    /// A sine of which the frequency changes.
    Chirp(Chirp),
    /// Along points of a table.
    File(Tabled),
    /// A sine that the slave is to follow, along a reference that is learnt from block to block (§
    /// 4.3).
    Learn(Learn),
}

/// One sine of a multisine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    /// Amplitude (rad or m).
    pub amplitude: f64,
    /// Frequency (Hz).
    pub frequency_hz: f64,
    /// Phase at the segment's start (rad).
    pub phase: f64,
}

/// The word for a movement in the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MovementKind {
    /// [`Movement::GuidedSine`].
    GuidedSine,
    /// [`Movement::Multisine`].
    Multisine,
    /// [`Movement::Steps`].
    Steps,
    /// [`Movement::Hold`].
    Hold,
    /// [`Movement::Rest`].
    Rest,
    /// [`Movement::Free`].
    Free,
    /// [`Movement::Initialise`].
    Initialise,
    /// [`Movement::Centre`].
    Centre,
    /// [`Movement::Rhythm`].
    Rhythm,
    /// [`Movement::Ramp`].
    Ramp,
    /// [`Movement::Chirp`].
    Chirp,
    /// [`Movement::File`].
    File,
    /// [`Movement::Learn`].
    Learn,
}

impl MovementKind {
    const WORDS: &'static [(&'static str, Self)] = &[
        ("guided_sine", Self::GuidedSine),
        ("multisine", Self::Multisine),
        ("steps", Self::Steps),
        ("hold", Self::Hold),
        ("rest", Self::Rest),
        ("free", Self::Free),
        ("initialise", Self::Initialise),
        ("centre", Self::Centre),
        ("rhythm", Self::Rhythm),
        ("ramp", Self::Ramp),
        ("chirp", Self::Chirp),
        ("file", Self::File),
        ("learn", Self::Learn),
    ];

    /// The word in the file.
    pub fn name(self) -> &'static str {
        Self::WORDS.iter().find(|(_, kind)| *kind == self).map_or("", |(word, _)| word)
    }
}

impl Movement {
    /// Its kind.
    pub const fn kind(&self) -> MovementKind {
        match self {
            Self::GuidedSine { .. } => MovementKind::GuidedSine,
            Self::Multisine { .. } => MovementKind::Multisine,
            Self::Steps { .. } => MovementKind::Steps,
            Self::Hold { .. } => MovementKind::Hold,
            Self::Rest { .. } => MovementKind::Rest,
            Self::Free { .. } => MovementKind::Free,
            Self::Initialise(_) => MovementKind::Initialise,
            Self::Centre(_) => MovementKind::Centre,
            Self::Rhythm(_) => MovementKind::Rhythm,
            Self::Ramp(_) => MovementKind::Ramp,
            Self::Chirp(_) => MovementKind::Chirp,
            Self::File(_) => MovementKind::File,
            Self::Learn(_) => MovementKind::Learn,
        }
    }

    /// Whole duration (s).
    pub fn duration_s(&self) -> f64 {
        match self {
            Self::GuidedSine { duration_s, .. }
            | Self::Multisine { duration_s, .. }
            | Self::Hold { duration_s, .. }
            | Self::Rest { duration_s }
            | Self::Free { duration_s, .. } => *duration_s,
            Self::Steps { positions, dwell_s, rise_s } => {
                positions.len() as f64 * (dwell_s + rise_s)
            }
            Self::Initialise(own) => own.duration_s,
            Self::Centre(own) => own.duration_s,
            Self::Rhythm(own) => own.duration_s,
            Self::Ramp(own) => own.duration_s,
            Self::Chirp(own) => own.duration_s,
            Self::File(own) => own.duration_s(),
            Self::Learn(learn) => learn.duration_s(),
        }
    }

    /// Bounds of the positions that it asks for: with the position at its start, it stays within
    /// their hull (rad or m). `None` where it asks for none.
    pub fn range(&self) -> Option<(f64, f64)> {
        match self {
            Self::GuidedSine { amplitude, centre, .. } => {
                Some((centre - amplitude, centre + amplitude))
            }
            Self::Multisine { lines, centre, .. } => {
                let sum: f64 = lines.iter().map(|line| line.amplitude).sum();
                Some((centre - sum, centre + sum))
            }
            Self::Steps { positions, .. } => {
                let least = positions.iter().copied().fold(f64::INFINITY, f64::min);
                Some((least, positions.iter().copied().fold(f64::NEG_INFINITY, f64::max)))
            }
            Self::Hold { position, .. } => position.map(|position| (position, position)),
            Self::Learn(learn) => {
                Some((learn.centre - learn.reach(), learn.centre + learn.reach()))
            }
            Self::Centre(own) => Some((own.position, own.position)),
            Self::Ramp(own) => Some((own.position, own.position)),
            Self::Chirp(own) => Some(own.range()),
            Self::File(own) => Some(own.spline.range()),
            Self::Rest { .. } | Self::Free { .. } | Self::Initialise(_) | Self::Rhythm(_) => None,
        }
    }

    /// Where it ends when it begins at `start`; `None` where nobody knows (rad or m).
    pub fn end(&self, start: Option<f64>) -> Option<f64> {
        match self {
            Self::GuidedSine { centre, .. } | Self::Multisine { centre, .. } => Some(*centre),
            Self::Learn(learn) => Some(learn.centre),
            Self::Steps { positions, .. } => positions.last().copied(),
            Self::Hold { position, .. } => position.or(start),
            Self::Centre(own) => Some(own.position),
            Self::Ramp(own) => Some(own.position),
            Self::Chirp(own) => Some(own.centre),
            Self::File(own) => Some(own.spline.end()),
            Self::Rest { .. } | Self::Free { .. } | Self::Initialise(_) | Self::Rhythm(_) => None,
        }
    }

    /// Whether the hand or the machine's ends decide where it ends: nobody knows before.
    pub const fn ends_anywhere(&self) -> bool {
        matches!(
            self,
            Self::Rest { .. } | Self::Free { .. } | Self::Initialise(_) | Self::Rhythm(_)
        )
    }

    /// A speed that it never passes when it begins at rest at `start` (rad/s or m/s).
    ///
    /// For sines this is the sum of what the lines and the fades can do at their worst together.
    pub fn peak_speed_from(&self, start: f64) -> f64 {
        let faded = |amplitude: f64, speed: f64, centre: f64, fade_in: f64, fade_out: f64| {
            let fading_in = MIN_JERK_PEAK_SPEED * ((centre - start).abs() + amplitude) / fade_in;
            let fading_out = MIN_JERK_PEAK_SPEED * amplitude / fade_out;
            speed + fading_in.max(fading_out)
        };
        match self {
            Self::GuidedSine { amplitude, frequency_hz, centre, fade_in_s, fade_out_s, .. } => {
                faded(*amplitude, amplitude * TAU * frequency_hz, *centre, *fade_in_s, *fade_out_s)
            }
            Self::Multisine { lines, centre, fade_in_s, fade_out_s, .. } => {
                let amplitude = lines.iter().map(|line| line.amplitude).sum();
                let speed = lines.iter().map(|line| line.amplitude * TAU * line.frequency_hz).sum();
                faded(amplitude, speed, *centre, *fade_in_s, *fade_out_s)
            }
            Self::Steps { positions, rise_s, .. } => {
                let starts = std::iter::once(start).chain(positions.iter().copied());
                let longest =
                    starts.zip(positions).map(|(from, to)| (to - from).abs()).fold(0.0, f64::max);
                MIN_JERK_PEAK_SPEED * longest / rise_s
            }
            Self::Hold { position: Some(position), rise_s, .. } => {
                MIN_JERK_PEAK_SPEED * (position - start).abs() / rise_s
            }
            Self::Learn(learn) => learn.peak_speed_from(start),
            Self::Initialise(own) => own.speed,
            Self::Centre(own) => MIN_JERK_PEAK_SPEED * (own.position - start).abs() / own.rise_s,
            Self::Ramp(own) => own.profile(start).speed,
            Self::Chirp(own) => faded(
                own.amplitude,
                own.amplitude * TAU * own.highest_hz(),
                own.centre,
                own.fade_in_s,
                own.fade_out_s,
            ),
            Self::File(own) => {
                let approach =
                    MIN_JERK_PEAK_SPEED * (own.spline.begin() - start).abs() / own.rise_s;
                own.spline.peak_speed().max(approach)
            }
            Self::Hold { position: None, .. }
            | Self::Rest { .. }
            | Self::Free { .. }
            | Self::Rhythm(_) => 0.0,
        }
    }
}

const GUIDED_HZ: Bounds = bounds(0.2, 3.0, "guided movements are of 0.2 to 3 Hz (ch. 4)");

impl Movement {
    pub(super) fn read(section: &Section<'_>) -> (Self, Option<AxisUnit>) {
        let mut lengths = Lengths { section, unit: None };
        let Some(kind) = section.word("kind", MovementKind::WORDS) else {
            // the other keys mean something in the kind that was meant
            section.know_all();
            return (Self::Rest { duration_s: 1.0 }, None);
        };
        let movement = match kind {
            MovementKind::GuidedSine => {
                let (duration_s, fade_in_s, fade_out_s) = read_times(section);
                Self::GuidedSine {
                    amplitude: lengths.required("amplitude", AMPLITUDE_DEG, AMPLITUDE_M),
                    frequency_hz: section.number("frequency_hz", GUIDED_HZ),
                    duration_s,
                    centre: lengths.optional("centre", POSITION_DEG, POSITION_M).unwrap_or(0.0),
                    fade_in_s,
                    fade_out_s,
                }
            }
            MovementKind::Multisine => {
                let (duration_s, fade_in_s, fade_out_s) = read_times(section);
                Self::Multisine {
                    lines: read_lines(section, &mut lengths),
                    duration_s,
                    centre: lengths.optional("centre", POSITION_DEG, POSITION_M).unwrap_or(0.0),
                    fade_in_s,
                    fade_out_s,
                }
            }
            MovementKind::Steps => Self::Steps {
                positions: lengths.list("positions", POSITION_DEG, POSITION_M),
                dwell_s: section.number("dwell_s", DURATION),
                rise_s: section.number_or("rise_s", 1.0, FADE),
            },
            MovementKind::Hold => {
                let duration_s = section.number("duration_s", DURATION);
                let position = lengths.optional("position", POSITION_DEG, POSITION_M);
                let rise_s = section.number_or_none("rise_s", FADE);
                if rise_s.is_some_and(|rise| rise > duration_s) {
                    let expected = format!("at most duration_s ({duration_s} s)");
                    section.problem(
                        "rise_s",
                        expected,
                        rise_s.unwrap_or_default(),
                        "the rise is part of the duration",
                    );
                }
                Self::Hold {
                    position,
                    rise_s: rise_s.unwrap_or(f64::min(1.0, duration_s / 2.0)),
                    duration_s,
                }
            }
            MovementKind::Rest => Self::Rest { duration_s: section.number("duration_s", DURATION) },
            MovementKind::Free => {
                let mut position = |stem| lengths.optional(stem, POSITION_DEG, POSITION_M);
                let (centre, walls) = (
                    position("centre").unwrap_or(0.0),
                    ["wall_min", "wall_max"].map(&mut position),
                );
                Self::Free {
                    duration_s: section.number("duration_s", DURATION),
                    field: Field::read(section, centre, walls),
                }
            }
            MovementKind::Initialise => Self::Initialise(Initialise::read(section, &mut lengths)),
            MovementKind::Centre => Self::Centre(Centre::read(section, &mut lengths)),
            MovementKind::Rhythm => Self::Rhythm(Rhythm::read(section, &mut lengths)),
            MovementKind::Ramp => Self::Ramp(Ramp::read(section, &mut lengths)),
            MovementKind::Chirp => Self::Chirp(Chirp::read(section, &mut lengths)),
            MovementKind::File => Self::File(Tabled::read(section, &mut lengths)),
            MovementKind::Learn => Self::Learn(Learn::read(section, &mut lengths)),
        };
        (movement, lengths.unit)
    }
}

/// Duration and fades of a sine; the fades share the duration.
pub(super) fn read_times(section: &Section<'_>) -> (f64, f64, f64) {
    let duration_s = section.number("duration_s", DURATION);
    let fade_in_s = section.number_or("fade_in_s", f64::min(1.0, duration_s / 2.0), FADE);
    let fade_out_s = section.number_or("fade_out_s", f64::min(fade_in_s, duration_s / 2.0), FADE);
    if fade_in_s + fade_out_s > duration_s {
        let key = if section.has("fade_in_s") || section.has("fade_out_s") {
            "fade_in_s"
        } else {
            "duration_s"
        };
        let expected = format!("fades of at most duration_s ({duration_s} s) together");
        let found = format!("{fade_in_s} s and {fade_out_s} s");
        section.problem(
            key,
            expected,
            found,
            "fade_out_s is as long as fade_in_s where it is not given",
        );
    }
    (duration_s, fade_in_s, fade_out_s)
}

fn read_lines(section: &Section<'_>, lengths: &mut Lengths<'_, '_>) -> Vec<Line> {
    let frequencies = section.numbers("frequencies_hz", LINE_HZ);
    let count = frequencies.len().max(1);
    let each = section.has("amplitudes_deg") || section.has("amplitudes_m");
    let amplitudes = if each {
        for key in ["amplitude_deg", "amplitude_m"] {
            section.misplaced(
                key,
                "either amplitudes, one a line, or one amplitude",
                "take one out",
            );
        }
        let amplitudes = lengths.list("amplitudes", AMPLITUDE_DEG, AMPLITUDE_M);
        if amplitudes.len() != frequencies.len() {
            let key = if section.has("amplitudes_m") { "amplitudes_m" } else { "amplitudes_deg" };
            let expected = format!("one for each of the {} frequencies", frequencies.len());
            section.problem(
                key,
                expected,
                amplitudes.len(),
                "give as many of the one as of the other",
            );
        }
        amplitudes
    } else {
        // the bound of the whole movement, shared by the lines
        vec![lengths.required("amplitude", AMPLITUDE_DEG, AMPLITUDE_M) / count as f64; count]
    };
    let mut random =
        section.whole_or("seed", 1, 0, i64::MAX as u64, "any whole number; it draws the phases");
    frequencies
        .into_iter()
        .zip(amplitudes)
        .map(|(frequency_hz, amplitude)| Line {
            amplitude,
            frequency_hz,
            phase: TAU * unit_random(&mut random),
        })
        .collect()
}

/// The next number from 0 to below 1 of the generator SplitMix64 (Steele, Lea, Flood, OOPSLA 2014):
/// the same phases from the same seed for ever, which a library's generator does not promise over
/// its releases.
fn unit_random(state: &mut u64) -> f64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^= z >> 31;
    (z >> 11) as f64 / (1u64 << 53) as f64
}

//! `learn`: a sine for the slave, whose master reference is learnt from block to block (§ 4.3).

use std::f64::consts::TAU;
use std::fmt::Display;

use ipc_types::Mode;

use crate::checked_toml::{Bounds, Keys, Section, bounds};
use crate::protocol::segment_kind::{Placement, SegmentKind};
use crate::protocol::sines::{Envelope, Line, sum};
use crate::protocol::trajectory::{MIN_JERK_PEAK_SPEED, Point};
use crate::protocol::unit_keys::{AMPLITUDE_DEG, AMPLITUDE_M, FADE, UnitKeys};

/// A sine that the *slave* is to follow; the reference of the master is learnt (iterative learning
/// control).
#[derive(Clone, Debug, PartialEq)]
pub struct Learn {
    /// Amplitude of the slave's sine (rad or m).
    pub amplitude: f64,
    /// Its frequency (Hz).
    pub frequency_hz: f64,
    /// Its centre (rad or m).
    pub centre: f64,
    /// Time of the blend from the start position into the movement (s).
    pub fade_in_s: f64,
    /// Time of the blend from the movement to rest at the centre (s).
    pub fade_out_s: f64,
    /// Cycles with the same reference.
    pub cycles_per_block: u32,
    /// Cycles at the beginning of a block that are not learnt from; the reference changes in the
    /// first.
    pub settling_cycles: u32,
    /// Number of blocks.
    pub blocks: u32,
    /// The learning law.
    pub law: LearnLaw,
    /// A block counts as worse when its error exceeds the best block's by this factor (1).
    pub growth: f64,
    /// Number of consecutive worse blocks that ends the learning.
    pub patience: u32,
    /// Whether control adds the rig's feed-forward (fig. 4.3A); § 4.3 simulates the feedback alone.
    pub feedforward: bool,
    /// Name under which the best reference is saved.
    pub save: Option<String>,
    /// Name of a saved reference to begin with.
    pub load: Option<String>,
}

/// The learning law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LearnLaw {
    /// None: a saved reference is played and its error reported.
    Keep,
    /// Eq. 4.3.2 and 4.3.3.
    Published {
        /// Change of the reference per error (1).
        gamma_p: f64,
        /// Change of the reference per change of the error since the block before (1).
        gamma_d: f64,
        /// Cut-off of the low pass on the error (Hz).
        cutoff_hz: f64,
        /// The transmission's delay (s).
        delay_s: f64,
    },
    /// Through the inverse of the frequency response, which is identified before the first block
    /// with one sine after another, three cycles of the movement each.
    ModelBased {
        /// Share of the inverse that is applied in a block (1).
        gain: f64,
        /// Regularisation: a response weaker than this is hardly inverted (1).
        regularisation: f64,
        /// Harmonics of the movement that are identified and learnt.
        harmonics: u32,
        /// Amplitude of the first sine; it falls with the root of the harmonic's number (rad or m).
        identify_amplitude: f64,
    },
}

/// Cycles of the movement for which each sine of the identification is played; the last is
/// evaluated.
pub const IDENTIFYING_CYCLES: u32 = 3;

const LEARN_HZ: Bounds =
    bounds(0.1, 3.0, "guided movements are of 0.2 to 2 Hz (ch. 4), up to 3 Hz in the appendix");
/// Largest sum of the two gains.
const MOST_GAMMA: f64 = 0.5;
const GAMMA: Bounds = bounds(
    0.0,
    MOST_GAMMA,
    "the gains are kept low (§ 4.3): at eq. 4.3.6's largest gain learning fails \
     from a sum of 0.5 on",
);
const CUTOFF: Bounds = bounds(0.5, 50.0, "the transmission passes nothing above (fig. 3.4)");
const DELAY: Bounds = bounds(0.0, 0.5, "§ 4.3 has 0.03 s");
const GAIN: Bounds = bounds(0.01, 1.0, "1 applies the whole inverse at once");
const REGULARISATION: Bounds =
    bounds(0.01, 10.0, "0.3 leaves out what the transmission hardly passes");
const GROWTH: Bounds = bounds(1.01, 100.0, "1.5 tolerates half as much error again");
/// Highest frequency at which the response is identified (Hz).
const HIGHEST_HZ: f64 = 24.0;

const LAWS: &[(&str, &str)] =
    &[("published", "published"), ("model-based", "model-based"), ("none", "none")];

pub(super) const KEYS: Keys = &[
    ("amplitude_{deg,m}", "Amplitude of the slave's sine."),
    ("frequency_hz", "Its frequency; a cycle must be a whole number of control periods."),
    ("centre_{deg,m}", "Its centre; 0, if left out."),
    ("fade_in_s", "Time of the blend from the start position into the movement."),
    ("fade_out_s", "Time of the blend from the movement to rest at the centre."),
    ("cycles_per_block", "Cycles with the same reference."),
    ("settling_cycles", "Cycles at the beginning of a block that are not learnt from."),
    ("blocks", "Number of blocks."),
    ("law", "Learning law: eq. 4.3.2, the inverse of the identified response, or none."),
    ("gamma_p", "Published law: change of the reference per error."),
    ("gamma_d", "Published law: change per change of the error since the previous block."),
    ("cutoff_hz", "Published law: cut-off of the low pass on the error."),
    ("delay_s", "Published law: delay of the transmission."),
    ("gain", "Model-based law: share of the inverse applied in a block."),
    ("regularisation", "Model-based law: a response weaker than this is hardly inverted."),
    ("harmonics", "Model-based law: number of harmonics identified and learnt."),
    ("identify_amplitude_{deg,m}", "Model-based law: amplitude of the first probing sine."),
    ("growth", "A block is worse when its error exceeds the best by this factor."),
    ("patience", "Number of consecutive worse blocks that ends the learning."),
    ("feedforward", "Whether control adds the rig's feed-forward (fig. 4.3A)."),
    ("save", "Name under which the best reference is saved."),
    ("load", "Name of a saved reference to begin with."),
];

pub(super) fn read(section: &Section<'_>, keys: &mut UnitKeys<'_, '_>) -> Learn {
    let amplitude = keys.amplitude("amplitude");
    let identify = keys.optional("identify_amplitude", AMPLITUDE_DEG, AMPLITUDE_M);
    let whole = |key, default, least, most, advice| {
        section.whole_or(key, default, least, most, advice) as u32
    };
    let blocks_of_three = "fig. 4.6 has blocks of three cycles";
    let first_cycle = "the reference changes in the first cycle of a block";
    let learn = Learn {
        amplitude,
        frequency_hz: section.number("frequency_hz", LEARN_HZ),
        centre: keys.position("centre").unwrap_or(0.0),
        fade_in_s: section.number_or("fade_in_s", 2.0, FADE),
        fade_out_s: section.number_or("fade_out_s", 1.0, FADE),
        cycles_per_block: whole("cycles_per_block", 3, 2, 100, blocks_of_three),
        settling_cycles: whole("settling_cycles", 1, 1, 99, first_cycle),
        blocks: section.whole("blocks", 1, 10_000, "number of blocks that are played at most")
            as u32,
        law: read_law(section, amplitude, identify),
        growth: section.number_or("growth", 1.5, GROWTH),
        patience: whole("patience", 5, 1, 1000, "worse blocks in a row that end the learning"),
        feedforward: section.flag_or("feedforward", true),
        save: section.file_name_or_none("save"),
        load: section.file_name_or_none("load"),
    };
    if learn.settling_cycles >= learn.cycles_per_block {
        let expected = format!("fewer than cycles_per_block ({})", learn.cycles_per_block);
        let key =
            if section.has("settling_cycles") { "settling_cycles" } else { "cycles_per_block" };
        section.problem(key, expected, learn.settling_cycles, "leave a cycle to learn from");
    }
    learn.check_law(section);
    learn
}

impl Learn {
    /// Checks the learning law's parameters against the movement.
    fn check_law(&self, section: &Section<'_>) {
        match self.law {
            LearnLaw::Keep if self.load.is_none() => {
                let advice = "name the saved reference to play";
                section.problem("law", "`load` beside law = \"none\"", "no `load`", advice);
            }
            LearnLaw::Published { gamma_p, gamma_d, delay_s, .. } => {
                let sum = gamma_p + gamma_d;
                if !(sum > 0.0 && sum <= MOST_GAMMA) {
                    let key = if section.has("gamma_p") { "gamma_p" } else { "gamma_d" };
                    let expected = format!("gamma_p + gamma_d above 0 and up to {MOST_GAMMA}");
                    let advice = "with more, learning does not converge (eq. 4.3.12)";
                    section.problem(key, expected, sum, advice);
                }
                if delay_s * self.frequency_hz >= 0.5 {
                    let expected =
                        format!("less than half a cycle ({} s)", 0.5 / self.frequency_hz);
                    let advice = "the delay of the transmission, § 4.3: 0.03 s";
                    section.problem("delay_s", expected, delay_s, advice);
                }
            }
            LearnLaw::ModelBased { harmonics, .. }
                if f64::from(harmonics) * self.frequency_hz > HIGHEST_HZ =>
            {
                let expected = format!("harmonics up to {HIGHEST_HZ} Hz");
                let found = format!("{} Hz", f64::from(harmonics) * self.frequency_hz);
                let advice = "learn fewer; the transmission hardly passes those";
                section.problem("harmonics", expected, found, advice);
            }
            _ => {}
        }
    }

    /// Number of cycles of the identification.
    pub fn identifying_cycles(&self) -> u32 {
        match self.law {
            LearnLaw::ModelBased { harmonics, .. } => harmonics * IDENTIFYING_CYCLES,
            _ => 0,
        }
    }

    /// Control periods in a cycle at `control_hz` (Hz); `None` where they are no whole number.
    pub fn steps_per_cycle(&self, control_hz: u32) -> Option<usize> {
        let steps = f64::from(control_hz) / self.frequency_hz;
        ((steps - steps.round()).abs() < 1e-6 && steps >= 8.0).then_some(steps.round() as usize)
    }

    fn envelope(&self) -> Envelope {
        let Self { centre, fade_in_s, fade_out_s, .. } = *self;
        Envelope { centre, duration_s: self.duration_s(), fade_in_s, fade_out_s }
    }

    /// Largest distance from the centre before anything is learnt (rad or m).
    fn reach(&self) -> f64 {
        match self.law {
            LearnLaw::ModelBased { identify_amplitude, .. } => {
                self.amplitude.max(identify_amplitude)
            }
            _ => self.amplitude,
        }
    }
}

impl SegmentKind for Learn {
    fn duration_s(&self) -> f64 {
        let cycles = self.identifying_cycles() + self.blocks * self.cycles_per_block;
        self.fade_in_s + f64::from(cycles) / self.frequency_hz + self.fade_out_s
    }

    fn range(&self) -> Option<(f64, f64)> {
        Some((self.centre - self.reach(), self.centre + self.reach()))
    }

    fn target(&self) -> Option<f64> {
        Some(self.centre)
    }

    /// Before anything is learnt: the speed of the sines, and of the change from one to the next,
    /// which takes half a cycle.
    fn peak_speed_from(&self, start: f64) -> f64 {
        let omega = TAU * self.frequency_hz;
        let sines = match self.law {
            LearnLaw::ModelBased { identify_amplitude, harmonics, .. } => {
                // Amplitude and speed of each sine in the order of playing.
                let own = (self.amplitude, self.amplitude * omega);
                let sine =
                    |h: f64| (identify_amplitude / h.sqrt(), identify_amplitude * h.sqrt() * omega);
                let played =
                    std::iter::once(own).chain((1..=harmonics).map(|h| sine(f64::from(h))));
                let next = (1..=harmonics).map(|h| sine(f64::from(h))).chain(std::iter::once(own));
                played
                    .zip(next)
                    .map(|((from, speed), (to, next_speed))| {
                        speed.max(next_speed)
                            + MIN_JERK_PEAK_SPEED * (from + to) * 2.0 * self.frequency_hz
                    })
                    .fold(0.0, f64::max)
            }
            _ => self.amplitude * omega,
        };
        let fading = self.envelope().peak_speed_from(start, self.amplitude, self.amplitude * omega);
        sines.max(fading)
    }

    fn feedforward_speed(&self) -> f64 {
        self.amplitude * TAU * self.frequency_hz
    }

    fn mode(&self, _time_s: f64) -> Mode {
        Mode::Learning
    }

    /// The reference before anything is learnt; the learning in the experiment process replaces it.
    fn at(&self, start: f64, time_s: f64, peak_speed: f64) -> Point {
        let (amplitude, frequency_hz) = (self.amplitude, self.frequency_hz);
        let line = Line { amplitude, frequency_hz, phase: 0.0 };
        let sine = sum(&[line], self.centre, time_s - self.fade_in_s);
        self.envelope().apply(sine, start, time_s, peak_speed)
    }

    /// The axis needs a slave encoder, and the control rate a whole number of periods in a cycle.
    fn check(&self, placed: &Placement<'_>) -> bool {
        let (axis, control_hz) = (placed.axis, placed.rig.rates.control_hz);
        let refuse = |name: &str, expected: String, found: &dyn Display, advice: &str| {
            placed.source.problem(&placed.key(name), expected, found, advice)
        };
        let mut fits = true;
        if axis.slave.is_none() {
            let expected =
                format!("an axis with an encoder at the slave (axis \"{}\" has none)", axis.name);
            let advice = "add axes.slave to the rig file";
            fits &= refuse("kind", expected, &"a movement to be learnt", advice);
        }
        if self.steps_per_cycle(control_hz).is_none() {
            let expected = format!(
                "a whole number of control steps in a cycle, 8 or more, at {control_hz} Hz"
            );
            let found = format!("{:.3}", f64::from(control_hz) / self.frequency_hz);
            let advice = "choose a frequency that divides the control rate";
            fits &= refuse("frequency_hz", expected, &found, advice);
        }
        let half = f64::from(control_hz) / 2.0;
        if let LearnLaw::Published { cutoff_hz, .. } = self.law
            && cutoff_hz >= half
        {
            let expected = format!("below {half} Hz");
            fits &= refuse("cutoff_hz", expected, &cutoff_hz, "half the control rate");
        }
        fits
    }

    fn single_axis(&self) -> bool {
        true
    }
}

fn read_law(section: &Section<'_>, amplitude: f64, identify_amplitude: Option<f64>) -> LearnLaw {
    let law = section.word("law", LAWS).unwrap_or_default();
    let published = ["gamma_p", "gamma_d", "cutoff_hz", "delay_s"];
    let model_based =
        ["gain", "regularisation", "harmonics", "identify_amplitude_deg", "identify_amplitude_m"];
    let others = match law {
        "published" => model_based.to_vec(),
        "model-based" => published.to_vec(),
        "none" => [&published[..], &model_based[..3]].concat(),
        _ => Vec::new(),
    };
    for key in others {
        let advice = "take it out, or choose the other law";
        section.misplaced(key, "keys of the law that was chosen", advice);
    }
    match law {
        "model-based" => LearnLaw::ModelBased {
            gain: section.number_or("gain", 0.6, GAIN),
            regularisation: section.number_or("regularisation", 0.3, REGULARISATION),
            harmonics: section.whole_or("harmonics", 9, 1, 100, "fig. 4.6 has nine, up to 9 Hz")
                as u32,
            identify_amplitude: identify_amplitude.unwrap_or(2.0 * amplitude),
        },
        "none" => LearnLaw::Keep,
        "published" => LearnLaw::Published {
            gamma_p: section.number_or("gamma_p", 0.1, GAMMA),
            gamma_d: section.number_or("gamma_d", 0.01, GAMMA),
            cutoff_hz: section.number_or("cutoff_hz", 8.0, CUTOFF),
            delay_s: section.number_or("delay_s", 0.03, DELAY),
        },
        // Without a valid law nobody can say which keys are right.
        _ => {
            section.know_all();
            LearnLaw::Published { gamma_p: 0.1, gamma_d: 0.01, cutoff_hz: 8.0, delay_s: 0.03 }
        }
    }
}

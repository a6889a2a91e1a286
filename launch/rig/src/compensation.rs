//! Options of the position law: friction compensation, disturbance observer, slave loop.

use crate::axis_unit::AxisUnit;
use crate::checked_toml::{Bounds, Keys, Section, bounds};
use crate::encoder::Encoder;

/// The feed-forward that the position law adds to its feedback.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CompensationKind {
    /// Triangle and inertia term of § 4.1 (fig. 4.3A), with the gains of `control.feedforward`.
    #[default]
    Printed,
    /// Friction and inertia of the declared model.
    Identified,
    /// No feed-forward.
    None,
}

/// The section `control.compensation`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Compensation {
    /// Kind of feed-forward.
    pub kind: CompensationKind,
    /// Share of the model's friction that is compensated, 0 to 1.
    pub share: f64,
    /// Speed range around zero within which the motor-friction compensation changes sign, ± this
    /// (rad/s or m/s).
    pub reversal_speed: f64,
}

impl Default for Compensation {
    fn default() -> Self {
        Self { kind: CompensationKind::Printed, share: 1.0, reversal_speed: 10f64.to_radians() }
    }
}

/// The section `control.observer`: a disturbance observer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observer {
    /// Cut-off of its filter (Hz).
    pub cutoff_hz: f64,
    /// Share of the estimated disturbance that is compensated, 0 to 1.
    pub share: f64,
    /// Its contribution to the output stays within ± this (V).
    pub limit_v: f64,
}

/// The section `control.slave`: an outer loop on the slave's position, around the master's loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlaveLoop {
    /// Largest offset of the master's reference by windup, ratio and feedback, and again by the
    /// constant, either way (rad or m).
    pub limit: f64,
    /// Share of the modelled windup of the line that is added to the reference, 0 to 1.
    pub windup_share: f64,
    /// Proportional gain from slave error to reference offset (1).
    pub proportional_gain: f64,
    /// Integral gain from slave error to reference offset (1/s).
    pub integral_gain: f64,
    /// Cut-off of the low pass on the slave's error (Hz).
    pub filter_hz: f64,
    /// Time by which the windup and ratio compensation leads the reference (s).
    pub lead_s: f64,
}

impl Default for Observer {
    fn default() -> Self {
        Self { cutoff_hz: 3.0, share: 1.0, limit_v: 1.5 }
    }
}

impl Default for SlaveLoop {
    /// For a rotary axis.
    fn default() -> Self {
        Self {
            limit: 20f64.to_radians(),
            windup_share: 1.0,
            proportional_gain: 0.3,
            integral_gain: 2.0,
            filter_hz: 3.0,
            lead_s: 0.03,
        }
    }
}

const SHARE: Bounds = bounds(0.0, 1.0, "a share from 0 (none) to 1 (all)");

const COMPENSATION_KEYS: Keys = &[
    ("kind", "The feed-forward; `identified` needs a transmission as the declared model."),
    ("share", "Share of the model's friction that is compensated."),
    (
        "reversal_{deg,m}_s",
        "Speed around zero within which the compensation of motor friction changes sign.",
    ),
];

impl Compensation {
    pub(crate) fn read(section: &Section<'_>, unit: AxisUnit) -> Self {
        section.document("[axes.control.compensation]", COMPENSATION_KEYS);
        let words = &[
            ("printed", CompensationKind::Printed),
            ("identified", CompensationKind::Identified),
            ("none", CompensationKind::None),
        ];
        let (key, speed) = unit.choose(("reversal_deg_s", 10.0), ("reversal_m_s", 0.01));
        let advice = "far below the movement's peak speed, above what the encoder resolves";
        let speeds = bounds(1e-4, 1e3, advice);
        Self {
            kind: section.word_or("kind", words, CompensationKind::default()),
            share: section.number_or("share", 1.0, SHARE),
            reversal_speed: section.number_or(key, speed, speeds) * unit.si_per_file_unit(),
        }
    }
}

const OBSERVER_KEYS: Keys = &[
    ("cutoff_hz", "Cut-off of the observer's filter."),
    ("share", "Share of the estimated disturbance that is compensated."),
    ("limit_v", "The observer's contribution stays within ± this."),
];

impl Observer {
    pub(crate) fn read(section: &Section<'_>) -> Self {
        section.document("[axes.control.observer]", OBSERVER_KEYS);
        let own = Self::default();
        let cutoff = bounds(0.1, 20.0, "below the line's resonance, in Hz");
        let limit = bounds(0.0, 10.0, "about the friction of the axis, in V");
        Self {
            cutoff_hz: section.number_or("cutoff_hz", own.cutoff_hz, cutoff),
            share: section.number_or("share", own.share, SHARE),
            limit_v: section.number_or("limit_v", own.limit_v, limit),
        }
    }
}

const SLAVE_KEYS: Keys = &[
    (
        "limit_{deg,m}",
        "Largest offset of the master's reference by windup, ratio and feedback, and again by what \
         lies constantly between master and slave; at most half the range.",
    ),
    ("windup_share", "Share of the modelled windup of the line that is added to the reference."),
    ("proportional_gain", "Proportional gain from slave error to reference offset."),
    ("integral_gain_per_s", "Integral gain from slave error to reference offset."),
    ("filter_hz", "Cut-off of the low pass on the slave's error."),
    ("lead_s", "Time by which the windup and ratio compensation leads the reference."),
];

impl SlaveLoop {
    /// `travel` is the width of the axis's position range (rad or m).
    pub(crate) fn read(section: &Section<'_>, unit: AxisUnit, travel: f64) -> Self {
        section.document("[axes.control.slave]", SLAVE_KEYS);
        let (key, limit) = unit.choose(("limit_deg", 20.0), ("limit_m", 0.02));
        let scale = unit.si_per_file_unit();
        let half_travel = (0.5 * travel / scale * 1e6).round() * 1e-6;
        let most = bounds(0.0, half_travel, "at most half the axis's range");
        let own = Self::default();
        let gain = bounds(0.0, 2.0, "reference offset per error, without unit");
        let rate = bounds(0.0, 20.0, "reference offset per error and time, in 1/s");
        let filter = bounds(0.1, 20.0, "below the line's resonance, in Hz");
        let lead = bounds(0.0, 0.1, "the lag of line and loop, in s");
        Self {
            limit: section.number_or(key, f64::min(limit, 0.5 * half_travel), most) * scale,
            windup_share: section.number_or("windup_share", own.windup_share, SHARE),
            proportional_gain: section.number_or("proportional_gain", own.proportional_gain, gain),
            integral_gain: section.number_or("integral_gain_per_s", own.integral_gain, rate),
            filter_hz: section.number_or("filter_hz", own.filter_hz, filter),
            lead_s: section.number_or("lead_s", own.lead_s, lead),
        }
    }
}

/// Options of one axis's position law.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ControlOptions {
    /// Friction compensation.
    pub compensation: Compensation,
    /// Disturbance observer; `None`: off.
    pub observer: Option<Observer>,
    /// Slave loop; `None`: off.
    pub slave: Option<SlaveLoop>,
}

impl ControlOptions {
    /// Reads the subsections of `control`; `slave` is the slave's encoder, `travel` the width of
    /// the axis's position range (rad or m).
    pub(crate) fn read(
        control: &Section<'_>,
        unit: AxisUnit,
        slave: Option<&Encoder>,
        travel: f64,
    ) -> Self {
        let section = control.section("compensation");
        let compensation = Compensation::read(&section, unit);
        let section = control.section("observer");
        let observer = section.exists().then(|| Observer::read(&section));
        let section = control.section("slave");
        let slave_loop = section.exists().then(|| SlaveLoop::read(&section, unit, travel));
        if slave.is_none() {
            let advice = "add the axis's slave encoder, or take the section out";
            let expected = "no slave loop where the slave's position is not measured";
            control.misplaced("slave", expected, advice);
        }
        Self { compensation, observer, slave: slave_loop }
    }

    /// The key of the first option that requires the declared model to be a transmission.
    pub(crate) fn needs_transmission(&self) -> Option<&'static str> {
        if self.slave.is_some() {
            return Some("control.slave");
        }
        if self.observer.is_some() {
            return Some("control.observer");
        }
        (self.compensation.kind == CompensationKind::Identified)
            .then_some("control.compensation.kind")
    }
}

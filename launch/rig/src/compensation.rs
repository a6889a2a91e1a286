//! Options of the position law: which friction compensation, a disturbance observer, a loop on the
//! slave; and what the declared model says of friction, inertia and compliance, in volts and as the
//! law needs it.

use plant::friction::StribeckCurve;
use plant::{any, cable, hydrostatic};

use crate::axis::{AxisUnit, Encoder};
use crate::read::{Bounds, Section, bounds};
use crate::rig_file::RigFile;

/// Which feed-forward the position law adds to its feedback.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CompensationKind {
    /// Sine and triangle of § 4.1 (fig. 4.3A), of `control.feedforward`.
    #[default]
    Printed,
    /// Friction and inertia of the declared model.
    Identified,
    /// None: feedback alone.
    None,
}

/// The section `control.compensation`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Compensation {
    /// Which.
    pub kind: CompensationKind,
    /// Share of the model's friction that is compensated, 0 to 1.
    pub share: f64,
    /// Speed below which the friction of the motor passes through its change of sign (rad/s or
    /// m/s).
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
    /// Share of what it finds that is compensated, 0 to 1.
    pub share: f64,
    /// What it adds stays within ± this (V).
    pub limit_v: f64,
}

/// The section `control.slave`: a loop on the slave around the master's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlaveLoop {
    /// How far the loop may move the master's reference, either way (rad or m).
    pub limit: f64,
    /// Share of the line's windup, as the model has it, that the reference is moved by; 0 to 1.
    pub windup_share: f64,
    /// Reference per slave error (1).
    pub proportional_gain: f64,
    /// Reference per slave error and time (1/s).
    pub integral_gain: f64,
    /// Cut-off of the filter of the slave's error (Hz).
    pub filter_hz: f64,
    /// How far ahead of the master the slave's friction is met (s).
    pub lead_s: f64,
}

impl Default for Observer {
    fn default() -> Self {
        Self { cutoff_hz: 3.0, share: 1.0, limit_v: 1.5 }
    }
}

impl Default for SlaveLoop {
    /// That of an axis that turns.
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

/// Points of a [`FrictionCurve`].
pub const CURVE_POINTS: usize = 65;

/// Magnitude of friction over speed (V), linear between evenly spaced speeds, and level beyond the
/// last.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrictionCurve {
    /// Distance of two points (rad/s or m/s), positive.
    pub step: f64,
    /// Level at rest, then at each step (V), none negative.
    pub levels_v: [f64; CURVE_POINTS],
}

impl FrictionCurve {
    /// A curve up to `speed_max` (rad/s or m/s, positive) from a function of the speed.
    pub fn new(speed_max: f64, level_v: impl Fn(f64) -> f64) -> Self {
        let step = speed_max / (CURVE_POINTS - 1) as f64;
        Self { step, levels_v: std::array::from_fn(|point| level_v(step * point as f64).max(0.0)) }
    }

    /// Level at a speed (V); its sign does not matter. 0 V for what is no number.
    pub fn level_v(&self, speed: f64) -> f64 {
        let place = speed.abs() / self.step;
        if place.is_nan() {
            return 0.0;
        }
        let place = place.min((CURVE_POINTS - 1) as f64);
        let at = (place as usize).min(CURVE_POINTS - 2);
        let part = place - at as f64;
        self.levels_v[at] * (1.0 - part) + self.levels_v[at + 1] * part
    }

    /// Its highest level (V).
    pub fn peak_v(&self) -> f64 {
        self.levels_v.iter().copied().fold(0.0, f64::max)
    }
}

/// What the declared model says of an axis, as volts at the motor for movements of the handle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IdentifiedAxis {
    /// Inertia of all that moves (V·s²/rad or V·s²/m).
    pub inertia_v: f64,
    /// Friction of motor and master, which no line stands before (V).
    pub near: FrictionCurve,
    /// Friction of line and slave, which the motor feels through the line (V).
    pub far: FrictionCurve,
    /// What of it winds the line up, each part by the share of the line that it pulls on (V); over
    /// `line_v`, how far the master is ahead of the slave.
    pub windup: FrictionCurve,
    /// Stiffness of the line: volts per how far the master is ahead of the slave (V/rad or V/m).
    pub line_v: f64,
    /// Movement of the handle per movement of the master with a rigid line, both in the handle's
    /// coordinates (1).
    pub ratio: f64,
}

const SHARE: Bounds = bounds(0.0, 1.0, "a share: 1 for all of it");

impl Compensation {
    pub(crate) fn read(section: &Section<'_>, unit: AxisUnit) -> Self {
        let words = &[
            ("printed", CompensationKind::Printed),
            ("identified", CompensationKind::Identified),
            ("none", CompensationKind::None),
        ];
        let (key, speed) = match unit {
            AxisUnit::Radian => ("reversal_deg_s", 10.0),
            AxisUnit::Metre => ("reversal_m_s", 0.01),
        };
        let speeds = bounds(
            1e-4,
            1e3,
            "far below the movement's peak speed, above what the encoder resolves",
        );
        Self {
            kind: section.word_or_none("kind", words).unwrap_or_default(),
            share: section.number_or("share", 1.0, SHARE),
            reversal_speed: section.number_or(key, speed, speeds) * unit.si_per_file_unit(),
        }
    }
}

impl Observer {
    pub(crate) fn read(section: &Section<'_>) -> Self {
        let own = Self::default();
        let cutoff = bounds(0.1, 20.0, "below the line's resonance, in Hz");
        Self {
            cutoff_hz: section.number_or("cutoff_hz", own.cutoff_hz, cutoff),
            share: section.number_or("share", own.share, SHARE),
            limit_v: section.number_or(
                "limit_v",
                own.limit_v,
                bounds(0.0, 10.0, "about the friction, in V"),
            ),
        }
    }
}

impl SlaveLoop {
    /// `way` is the width of the axis's range (rad or m).
    pub(crate) fn read(section: &Section<'_>, unit: AxisUnit, way: f64) -> Self {
        let (key, limit) = match unit {
            AxisUnit::Radian => ("limit_deg", 20.0),
            AxisUnit::Metre => ("limit_m", 0.02),
        };
        let scale = unit.si_per_file_unit();
        let half_way = (0.5 * way / scale * 1e6).round() * 1e-6;
        let most = bounds(0.0, half_way, "at most half the axis's range");
        let number =
            |key, own, most, advice| section.number_or(key, own, bounds(0.0, most, advice));
        let own = Self::default();
        let filter = bounds(0.1, 20.0, "below the line's resonance, in Hz");
        Self {
            limit: section.number_or(key, f64::min(limit, 0.5 * half_way), most) * scale,
            windup_share: section.number_or("windup_share", own.windup_share, SHARE),
            proportional_gain: number(
                "proportional_gain",
                own.proportional_gain,
                2.0,
                "reference per error",
            ),
            integral_gain: number("integral_gain_per_s", own.integral_gain, 20.0, "1/s"),
            filter_hz: section.number_or("filter_hz", own.filter_hz, filter),
            lead_s: number("lead_s", own.lead_s, 0.1, "the lag of line and loop, in s"),
        }
    }
}

impl RigFile {
    /// What the declared model says of an axis; `None` where it is no transmission, or there is no
    /// such axis.
    ///
    /// The friction of a hydrostatic transmission is that of § 3.2.1 with the loss in both hoses;
    /// that of a cable is at pretension, mean of both directions and all positions. `line_v` is the
    /// stiffness of both lines at rest. What declared effects change of them is in
    /// ([`RigFile::control_parameters`]).
    pub fn identified(&self, axis: usize) -> Option<IdentifiedAxis> {
        let axis = self.axes.get(axis)?;
        let gear = axis.master.turns_per_handle_turn;
        let speed_max = axis.limits.speed_max;
        match self.control_parameters(axis).ok()? {
            any::Parameters::Hydrostatic(model) => Some(hydrostatic_axis(&model, gear, speed_max)),
            any::Parameters::Cable(model) => Some(cable_axis(&model, gear, speed_max)),
        }
    }
}

fn hydrostatic_axis(model: &hydrostatic::Parameters, gear: f64, speed_max: f64) -> IdentifiedAxis {
    let per_volt = model.motor_torque_per_volt_nm;
    let (piston, slave, pipe) =
        (model.master_piston_friction(), model.slave_friction(), model.pipe());
    let (displacement, ratio) = (model.master_displacement_m_per_rad(), model.transmission_ratio());
    let near = |speed: f64| {
        let motor = gear * speed;
        (model.motor_coulomb_nm + model.motor_viscous_nm_s * motor + piston.level(motor)) / per_volt
    };
    // The oil rubs along the whole line: in the model, in its middle.
    let far = |speed: f64, of_the_oil: f64| {
        let motor = gear * speed;
        let fluid = displacement * motor;
        let oil = 2.0 * displacement * pipe.coefficient(fluid) * fluid;
        (ratio * slave.level(ratio * motor) + of_the_oil * oil) / per_volt
    };
    let inertia = model.master_inertia_kg_m2()
        + ratio * ratio * model.slave_inertia_kg_m2()
        + 2.0 * displacement * displacement * model.fluid_mass_kg();
    IdentifiedAxis {
        inertia_v: gear * inertia / per_volt,
        near: FrictionCurve::new(speed_max, near),
        far: FrictionCurve::new(speed_max, |speed| far(speed, 1.0)),
        windup: FrictionCurve::new(speed_max, |speed| far(speed, 0.5)),
        line_v: gear * 2.0 * displacement * displacement * model.line_stiffness_n_per_m()
            / per_volt,
        ratio: gear * ratio,
    }
}

fn cable_axis(model: &cable::Parameters, gear: f64, speed_max: f64) -> IdentifiedAxis {
    let per_volt = model.motor_torque_per_volt_nm;
    let (radius, ratio) = (model.master_pulley_radius_m, model.transmission_ratio());
    let support = model.support_friction_n(model.cables * model.pretension_n);
    let falling = StribeckCurve {
        kinetic: model.kinetic_friction_ratio,
        breakaway: 1.0,
        speed: model.stribeck_speed_m_s,
        exponent: 1.0,
    };
    let viscous = model.cables * model.support_viscous_n_s_per_m;
    // Two lines; of each, one support stands at the master, one at the slave, and the others in the
    // model's middle.
    let supports = |speed: f64| {
        2.0 * radius * (support * falling.level(radius * speed) + viscous * radius * speed)
    };
    let near = |speed: f64| {
        let motor = gear * speed;
        (model.motor_coulomb_nm + model.motor_viscous_nm_s * motor + supports(motor)) / per_volt
    };
    let far = |speed: f64, of_the_middle: f64| {
        let along = 1.0 + of_the_middle * (model.supports() - 2.0);
        (along * supports(gear * speed) + ratio * model.slave_bearing_nm) / per_volt
    };
    let inertia = model.total_master_inertia_kg_m2()
        + ratio * ratio * model.total_slave_inertia_kg_m2()
        + 2.0 * radius * radius * model.middle_mass_kg();
    IdentifiedAxis {
        inertia_v: gear * inertia / per_volt,
        near: FrictionCurve::new(speed_max, near),
        far: FrictionCurve::new(speed_max, |speed| far(speed, 1.0)),
        windup: FrictionCurve::new(speed_max, |speed| far(speed, 0.5)),
        line_v: gear * 2.0 * radius * radius * model.line_stiffness_n_per_m() / per_volt,
        ratio: gear * ratio,
    }
}

/// The options of one axis, as its section `control` gives them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ControlOptions {
    /// Which feed-forward.
    pub compensation: Compensation,
    /// The disturbance observer; `None`: off.
    pub observer: Option<Observer>,
    /// The loop on the slave; `None`: off.
    pub slave: Option<SlaveLoop>,
}

impl ControlOptions {
    /// From the section `control`; `slave` is the slave's encoder, `way` the width of the axis's
    /// range (rad or m).
    pub(crate) fn read(
        control: &Section<'_>,
        unit: AxisUnit,
        slave: Option<&Encoder>,
        way: f64,
    ) -> Self {
        let section = control.section("compensation");
        let compensation = Compensation::read(&section, unit);
        section.finish();
        let section = control.section("observer");
        let observer = section.exists().then(|| Observer::read(&section));
        section.finish();
        let section = control.section("slave");
        let loop_on_slave = section.exists().then(|| SlaveLoop::read(&section, unit, way));
        section.finish();
        if slave.is_none() {
            let advice = "add the axis's slave encoder, or take the section out";
            control.misplaced(
                "slave",
                "no loop on the slave where its position is not measured",
                advice,
            );
        }
        Self { compensation, observer, slave: loop_on_slave }
    }

    /// The key of an option that needs the declared model to be a transmission.
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

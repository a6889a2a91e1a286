//! Inertia, friction and line stiffness of a transmission, reflected to its motor and expressed in
//! volts: what a feed-forward control law needs to know of the model.

use crate::transmission::TransmissionParameters;

/// Points of a [`FrictionCurve`].
pub const CURVE_POINTS: usize = 65;

/// Magnitude of friction over speed (V): linear between evenly spaced speeds, constant above the
/// highest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrictionCurve {
    /// Distance between two points (rad/s or m/s), positive.
    step: f64,
    /// Level at rest, then at each step (V); none is negative.
    levels_v: [f64; CURVE_POINTS],
    /// The highest of them (V).
    peak_v: f64,
}

impl FrictionCurve {
    /// Samples a function of the speed up to `speed_max` (rad/s or m/s, positive).
    pub fn new(speed_max: f64, level_v: impl Fn(f64) -> f64) -> Self {
        let step = speed_max / (CURVE_POINTS - 1) as f64;
        let levels_v: [f64; CURVE_POINTS] =
            std::array::from_fn(|point| level_v(step * point as f64).max(0.0));
        // Once: the control law needs it in every cycle.
        let peak_v = levels_v.iter().copied().fold(0.0, f64::max);
        Self { step, levels_v, peak_v }
    }

    /// Level at a speed of either sign (V); 0 V where the speed is not a number.
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

    /// Highest level (V).
    pub const fn peak_v(&self) -> f64 {
        self.peak_v
    }
}

/// Dynamics of a transmission reflected to the motor: motor volts over movements of the handle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReflectedDynamics {
    /// Inertia of all moving parts (V·s²/rad or V·s²/m).
    pub inertia_v: f64,
    /// Friction at the motor and the master, which acts on the motor directly (V).
    pub master_friction: FrictionCurve,
    /// Friction of line and slave, which acts on the motor through the line (V).
    pub slave_friction: FrictionCurve,
    /// The part of it that winds up the line, each source weighted by the share of the line that
    /// it loads (V); divided by `line_v`, the lead of the master over the slave.
    pub windup: FrictionCurve,
    /// Stiffness of the line: volts per lead of the master over the slave (V/rad or V/m).
    pub line_v: f64,
    /// Movement of the handle per movement of the master with a rigid line, both in the handle's
    /// coordinates (1).
    pub ratio: f64,
}

impl ReflectedDynamics {
    /// Of a transmission whose motor turns `gear` times per turn of the handle, for speeds up to
    /// `speed_max` (rad/s or m/s).
    ///
    /// The friction of a hydrostatic transmission is that of § 3.2.1 with the loss in both hoses;
    /// that of a cable is at pretension, the mean over both directions and all positions. `line_v`
    /// is the stiffness of both lines at rest.
    pub fn new(parameters: &dyn TransmissionParameters, gear: f64, speed_max: f64) -> Self {
        let per_volt = parameters.motor_torque_per_volt_nm();
        let (displacement, ratio) =
            (parameters.master_displacement_m_per_rad(), parameters.transmission_ratio());
        let curve = |side: usize, line_share: f64| {
            FrictionCurve::new(speed_max, |speed| {
                parameters.friction_at_motor_nm(gear * speed, line_share)[side] / per_volt
            })
        };
        let [master, slave] = parameters.inertia_kg_m2();
        let inertia = master
            + ratio * ratio * slave
            + 2.0 * displacement * displacement * parameters.middle_mass_kg();
        let line = parameters.line_stiffness_n_per_m();
        Self {
            inertia_v: gear * inertia / per_volt,
            master_friction: curve(0, 1.0),
            slave_friction: curve(1, 1.0),
            windup: curve(1, 0.5),
            line_v: gear * 2.0 * displacement * displacement * line / per_volt,
            ratio: gear * ratio,
        }
    }
}

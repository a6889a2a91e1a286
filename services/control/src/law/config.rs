//! Configuration of the control law, taken from the rig file.

use ipc_types::AXES;
use plant::reflected_dynamics::ReflectedDynamics;
use rig::{AxisControl, Limits, RigFile, StopSearch};

/// Longest time in which a moving reference is brought to rest when its target is lost (s).
pub const STOP_S: f64 = 0.25;
/// The reference catches up with a far target at this fraction of the axis's speed limit.
const CATCH_UP: f64 = 0.2;

/// Gains, limits and model of one axis, as the rig file has them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AxisLaw {
    /// Gains and options.
    pub control: AxisControl,
    /// Limits on position, speed and output.
    pub limits: Limits,
    /// Ends of the handle's movement with a person at it, where the soft stops are (rad or m).
    pub movement_range: (f64, f64),
    /// Limits while the axis is unhomed; `None` for absolute encoders.
    pub search: Option<StopSearch>,
    /// Dynamics of the declared model; options that need it are off without it.
    pub model: Option<ReflectedDynamics>,
}

impl AxisLaw {
    /// Highest speed at which the reference catches up with a far target, on top of the target's
    /// own (rad/s or m/s).
    pub(super) fn catch_up_speed(&self) -> f64 {
        CATCH_UP * self.limits.speed_max
    }

    /// Range of the reference (rad or m); while the axis is unhomed, about its position at
    /// power-up.
    pub(super) fn position_range(&self, homed: bool) -> (f64, f64) {
        match self.search {
            Some(search) if !homed => search.range(),
            _ => (self.limits.position_min, self.limits.position_max),
        }
    }

    /// Range at whose ends the soft stops of force control are (rad or m); while the axis is
    /// unhomed, that of the search.
    pub(super) fn hand_range(&self, homed: bool) -> (f64, f64) {
        match self.search {
            Some(search) if !homed => search.range(),
            _ => self.movement_range,
        }
    }

    /// The rig's own limit on the output (V).
    pub(super) fn output_limit_v(&self, homed: bool) -> f64 {
        let own = self.control.output_limit_v;
        self.search.filter(|_| !homed).map_or(own, |search| search.volts_max.min(own))
    }

    /// Time in which a moving reference comes to rest when its target is lost or replaced (s).
    pub(super) fn stop_s(&self) -> f64 {
        self.control.ramp_s.min(STOP_S)
    }
}

/// Configuration of the law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LawConfig {
    /// Axes of the rig.
    pub axes: usize,
    /// Gains, limits and model of each axis.
    pub axis: [AxisLaw; AXES],
    /// Period of the control loop (s), taken as the elapsed time of the first step.
    pub period_s: f64,
}

impl LawConfig {
    /// Reads the configuration from a rig file.
    pub fn of_rig(rig: &RigFile) -> Self {
        let mut laws = [AxisLaw::default(); AXES];
        for (index, (law, axis)) in laws.iter_mut().zip(&rig.axes).enumerate() {
            let (control, limits) = (axis.control, axis.limits);
            let search = axis.stop_search().copied();
            let (movement_range, model) = (axis.movement_range(), rig.reflected_dynamics(index));
            *law = AxisLaw { control, limits, movement_range, search, model };
        }
        let period_s = 1.0 / f64::from(rig.rates.control_hz);
        Self { axes: rig.axes.len(), axis: laws, period_s }
    }
}

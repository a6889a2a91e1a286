//! Gains and limits of an axis's control law.

use crate::axis_unit::{AxisUnit, KeyNames};
use crate::checked_toml::{Keys, Section, bounds};
use crate::compensation::ControlOptions;
use crate::encoder::Encoder;
use crate::force_control::ForceControl;
use crate::limits::{Limits, VOLTS};
use crate::rates::Rates;
use crate::torque_channel::TorqueChannel;

/// Gains and limits of the control law (§ 4.1).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AxisControl {
    /// Volts per position error: P of § 4.1 times the encoder's counts (V/rad or V/m).
    pub position_gain: f64,
    /// Volts per velocity error: D of § 4.1 times the encoder's counts (V·s/rad or V·s/m).
    pub velocity_gain: f64,
    /// Cut-off of the low pass of the velocity estimate (Hz).
    pub velocity_filter_hz: f64,
    /// The output stays within ± this, at most `limits.volts_max` (V).
    pub output_limit_v: f64,
    /// Feed-forward for guided movements.
    pub feedforward: Feedforward,
    /// Time in which the reference moves from the measured position to the setpoint (s).
    pub ramp_s: f64,
    /// Whether gains are accepted that the declared transmission would not keep stable.
    pub accept_unstable: bool,
    /// Force control; `None` where the hand's torque is not measured.
    pub force: Option<ForceControl>,
    /// Friction compensation, disturbance observer, slave loop.
    pub options: ControlOptions,
}

/// Feed-forward of § 4.1, fig. 4.3A: a triangle against friction and an inertia term.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Feedforward {
    /// Friction compensation at the turning points of the movement (V).
    pub friction_peak_v: f64,
    /// Friction compensation at peak speed (V).
    pub friction_floor_v: f64,
    /// Volts per acceleration (V·s²/rad or V·s²/m).
    pub inertia_v: f64,
}

const KEYS: Keys = &[
    ("p_v_per_count", "Position gain P of § 4.1; required on an axis in m."),
    ("d_v_s_per_count", "Velocity gain D of § 4.1; required on an axis in m."),
    ("velocity_filter_hz", "Cut-off of the low pass of the velocity estimate."),
    ("output_limit_v", "The output stays within ± this; `limits.volts_max`, if left out."),
    ("feedforward", "Printed feed-forward (fig. 4.3A)."),
    ("ramp_s", "Time in which the reference moves from the measured position to the setpoint."),
    ("accept_unstable", "Accept gains that the declared transmission would not keep stable."),
    ("force", "Gains of force control; needs a torque channel."),
    ("compensation", "Friction compensation."),
    ("observer", "Disturbance observer; off, if left out."),
    ("slave", "Loop on the slave's position; off, if left out."),
];

impl AxisControl {
    pub(crate) fn read(
        section: Section<'_>,
        unit: AxisUnit,
        (master, slave): (&Encoder, Option<&Encoder>),
        torque: Option<&TorqueChannel>,
        limits: &Limits,
        rates: &Rates,
    ) -> Self {
        section.document("[axes.control]", KEYS);
        let travel = limits.position_max - limits.position_min;
        let gain = |key, printed| {
            let bounds = bounds(0.0, 1.0, "volts per count: § 4.1 has P = 4.5e-3 and D = 7e-4");
            // The thesis's gains are per count of its rotary encoder: no default in metres.
            let per_count = match unit {
                AxisUnit::Radian => section.number_or(key, printed, bounds),
                AxisUnit::Metre => section.number(key, bounds),
            };
            per_count * master.counts_per_unit
        };
        let nyquist = f64::from(rates.control_hz) / 2.0;
        let filter =
            bounds(1.0, nyquist, "at most half the control rate; above it nothing is filtered");
        let usual = f64::min(40.0, nyquist);
        let control = Self {
            position_gain: gain("p_v_per_count", 4.5e-3),
            velocity_gain: gain("d_v_s_per_count", 7e-4),
            velocity_filter_hz: section.number_or("velocity_filter_hz", usual, filter),
            output_limit_v: section.number_or("output_limit_v", limits.volts_max, VOLTS),
            feedforward: Feedforward::read(section.section("feedforward"), unit),
            ramp_s: section.number_or("ramp_s", 1.0, bounds(0.1, 10.0, "in seconds")),
            accept_unstable: section.flag_or("accept_unstable", false),
            force: torque.map(|torque| {
                let force = section.section("force");
                ForceControl::read(&force, master, torque, travel, unit.si_per_file_unit())
            }),
            options: ControlOptions::read(&section, unit, slave, travel),
        };
        if torque.is_none() {
            let advice = "add the axis's torque channel, or take the section out";
            section.misplaced("force", "no force control where no torque is measured", advice);
        }
        control
    }
}

const FEEDFORWARD_KEYS: Keys = &[
    ("friction_peak_v", "Friction compensation at the turning points of the movement."),
    ("friction_floor_v", "Friction compensation at peak speed; at most friction_peak_v."),
    ("inertia_v_per_{rad,m}_s2", "Volts per acceleration: inertia divided by torque per volt."),
];

impl Feedforward {
    fn read(section: Section<'_>, unit: AxisUnit) -> Self {
        section.document("[axes.control.feedforward]", FEEDFORWARD_KEYS);
        let inertia = unit.key(&section, KeyNames("inertia_v_per_rad_s2", "inertia_v_per_m_s2"));
        let (peak, floor) = unit.choose((1.5, 1.2), (0.0, 0.0));
        let peaks = bounds(0.0, 5.0, "ch. 4 measured 1.5 ± 0.3 V");
        let peak = section.number_or("friction_peak_v", peak, peaks);
        let floors =
            bounds(0.0, peak, "at most friction_peak_v, as friction falls with speed (§ 4.1)");
        let floor = section.number_or("friction_floor_v", f64::min(floor, peak), floors);
        let inertias = bounds(0.0, 10.0, "inertia divided by torque per volt");
        let inertia_v = section.number_or(inertia, 0.0, inertias);
        Self { friction_peak_v: peak, friction_floor_v: floor, inertia_v }
    }
}

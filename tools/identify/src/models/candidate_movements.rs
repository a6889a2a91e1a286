//! Candidate movements of the next experiment: as protocol text, and as simulated by a model.

use std::f64::consts::TAU;

use plant::reflected_dynamics::ReflectedDynamics;
use plant::transmission::{Input, Transmission as _};
use plant::transmission_kinds::Plant;
use rig::{AxisUnit, RigFile};

use crate::equation_error::block_roles::Role;
use crate::prediction_error::parametric_bootstrap::ServoGains;
use crate::prediction_error::record::Record;

/// Duration of a simulated movement (s).
pub(super) const PREDICTED_S: f64 = 8.0;
/// Duration of a played movement (s): long enough to be segmented.
pub(super) const PLAYED_S: f64 = 24.0;
/// Fade-in of a sine (s).
const FADE_S: f64 = 1.0;
/// Rise and rest of a step (s).
const RISE_S: f64 = 0.4;
const DWELL_S: f64 = 1.1;
/// Largest share of the rig's limits that a movement may use.
const MARGIN: f64 = 0.7;
/// Duration of acceleration and deceleration of a stroke (s).
const EASE_S: f64 = 0.2;

/// The rig's limits and control gains.
#[derive(Clone, Copy, Debug)]
pub struct RigCapability {
    /// The axis.
    axis: usize,
    /// Range of the handle, and its middle (rad).
    range: (f64, f64),
    /// Highest speed of the handle (rad/s).
    speed_max: f64,
    /// Most volts.
    volts_max: f64,
    /// Period of control, and scans in it.
    control_s: f64,
    scans: u32,
    /// Gains (V/rad, V·s/rad).
    gains: (f64, f64),
    /// Speed through which friction changes its sign (rad/s).
    reversal_speed: f64,
    /// Turns of the model's master per turn of the handle.
    gear: f64,
    model: ReflectedDynamics,
}

impl RigCapability {
    /// Returns the capability of a rotary axis of a rig; `None` for others, and for models that are
    /// not transmissions.
    pub fn of(rig: &RigFile, number: usize) -> Option<Self> {
        let axis = rig.axes.get(number)?;
        (axis.unit == AxisUnit::Radian).then_some(())?;
        let limits = axis.limits;
        Some(Self {
            axis: number,
            range: axis.movement_range(),
            speed_max: limits.speed_max,
            volts_max: axis.control.output_limit_v.min(limits.volts_max),
            control_s: 1.0 / f64::from(rig.rates.control_hz),
            scans: (rig.rates.acquisition_hz / rig.rates.control_hz).max(1),
            gains: (axis.control.position_gain, axis.control.velocity_gain),
            reversal_speed: axis.control.options.compensation.reversal_speed,
            gear: axis.master.turns_per_handle_turn,
            model: rig.reflected_dynamics(number)?,
        })
    }

    /// Servo gains referred to the model's master.
    pub(super) fn servo_gains(&self) -> ServoGains {
        let (position_gain, velocity_gain) = (self.gains.0 / self.gear, self.gains.1 / self.gear);
        ServoGains { position_gain, velocity_gain, volts_max: self.volts_max }
    }

    fn middle(&self) -> f64 {
        0.5 * (self.range.0 + self.range.1)
    }

    /// Whether the rig can play a movement with margin: amplitude (rad), peak speed (rad/s), peak
    /// acceleration (rad/s²).
    fn can_play(&self, amplitude: f64, speed: f64, acceleration: f64) -> bool {
        let volts = self.model.inertia_v * acceleration
            + self.model.master_friction.peak_v()
            + self.model.slave_friction.peak_v();
        amplitude <= MARGIN * 0.5 * (self.range.1 - self.range.0)
            && speed <= MARGIN * self.speed_max
            && volts <= MARGIN * self.volts_max
    }

    /// Simulates a movement from rest with noise-free sensors and no hand at the handle, under
    /// position control with feed-forward of the declared friction and inertia, which approximates
    /// the rig's control.
    pub(super) fn record(&self, movement: Movement, mut plant: Plant) -> Record {
        let step_s = self.control_s / f64::from(self.scans);
        plant = plant.with_longest_step(step_s);
        plant.rest_at(self.gear * self.middle(), None);
        let cycles = (PREDICTED_S / self.control_s) as usize;
        let rows = cycles * self.scans as usize;
        let mut columns: [Vec<f64>; 4] = std::array::from_fn(|_| Vec::with_capacity(rows));
        let mut before = None;
        for cycle in 0..cycles {
            let (position, velocity, acceleration) =
                movement.reference(cycle as f64 * self.control_s);
            let master = plant.reading().master_rad / self.gear;
            let speed = before.map_or(0.0, |before| (master - before) / self.control_s);
            before = Some(master);
            let level = self.model.master_friction.level_v(velocity)
                + self.model.slave_friction.level_v(velocity);
            let volts = self.gains.0 * (self.middle() + position - master)
                + self.gains.1 * (velocity - speed)
                + self.model.inertia_v * acceleration
                + level * (velocity / self.reversal_speed).clamp(-1.0, 1.0);
            let volts = volts.clamp(-self.volts_max, self.volts_max);
            for _ in 0..self.scans {
                let reading = plant.reading();
                let values =
                    [volts, reading.master_rad, reading.slave_rad, reading.slave_torque_nm];
                columns.iter_mut().zip(values).for_each(|(column, value)| column.push(value));
                plant.step(Input { motor_v: volts, hand_torque_nm: 0.0 }, step_s);
            }
        }
        let [volts, master, slave, torque] = columns;
        Record {
            name: movement.words(),
            start_s: 0.0,
            step_s,
            volts,
            master,
            slave: Some(slave),
            torque: Some(torque),
            sign_flipped: Vec::new(),
            role: Role::Fit,
            count_rad: [0.0; 2],
            idle: true,
            others: Vec::new(),
            steps: 1,
            jumps: Default::default(),
        }
        .thinned()
    }

    /// Returns a protocol that plays these movements one after the other.
    pub(super) fn protocol(&self, name: &str, description: &str, movements: &[Movement]) -> String {
        let degrees = |rad: f64| (rad.to_degrees() * 10.0).round() / 10.0;
        let middle = degrees(self.middle());
        let hold = |label: &str| {
            format!(
                "[[segments]]\nkind = \"hold\"\nlabel = \"{label}\"\nposition_deg = {middle:?}\n\
                 rise_s = 1.0\nduration_s = 2.0\n\n"
            )
        };
        let mut text = format!(
            "# Written by farreach identify --propose-experiment. Nobody at the handle.\n\n\
             [protocol]\nname = \"{name}\"\ndescription = \
             \"{description}\"\n\n{}",
            hold("to the middle")
        );
        for movement in movements {
            text += &movement.segments(middle);
            text += &hold("settle");
        }
        if self.axis > 0 {
            // Without the key a segment moves axis 0.
            text = text.replace("[[segments]]", &format!("[[segments]]\naxis = {}", self.axis));
        }
        text.trim_end().to_owned() + "\n"
    }
}

/// One movement about the middle of the range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Movement {
    /// A sine: amplitude (°), frequency (Hz).
    Sine(f64, f64),
    /// A triangle at constant speed: amplitude (°), speed (°/s).
    Triangle(f64, f64),
    /// Fast steps from side to side with dwell: amplitude (°).
    Steps(f64),
}

impl Movement {
    /// Returns all candidates that the rig can play.
    pub(super) fn all(capability: &RigCapability) -> Vec<Self> {
        let mut all = Vec::new();
        for amplitude in [2.0, 5.0, 10.0, 20.0, 40.0, 60.0] {
            all.extend(
                [0.2, 0.5, 1.0, 2.0, 3.0, 5.0, 8.0]
                    .map(|frequency| Self::Sine(amplitude, frequency)),
            );
            all.extend([5.0, 20.0, 60.0].map(|speed| Self::Triangle(amplitude, speed)));
            all.push(Self::Steps(amplitude));
        }
        all.retain(|movement| {
            let (amplitude, speed, acceleration) = movement.peaks();
            capability.can_play(amplitude, speed, acceleration)
                && movement.period_s() <= PREDICTED_S
        });
        all
    }

    /// Period (s).
    fn period_s(self) -> f64 {
        match self {
            Self::Sine(_, frequency) => 1.0 / frequency,
            Self::Triangle(..) => 2.0 * self.stroke_s(),
            Self::Steps(_) => 2.0 * (RISE_S + DWELL_S),
        }
    }

    /// Time of one stroke from side to side (s).
    fn stroke_s(self) -> f64 {
        match self {
            Self::Triangle(amplitude, speed) => 2.0 * amplitude / speed + EASE_S,
            _ => 0.5 * self.period_s(),
        }
    }

    /// Amplitude, peak speed and peak acceleration (rad, rad/s, rad/s²).
    pub(super) fn peaks(self) -> (f64, f64, f64) {
        match self {
            Self::Sine(amplitude, frequency) => {
                let (amplitude, omega) = (amplitude.to_radians(), TAU * frequency);
                (amplitude, amplitude * omega, amplitude * omega * omega)
            }
            Self::Triangle(amplitude, speed) => {
                (amplitude.to_radians(), speed.to_radians(), 2.0 * speed.to_radians() / EASE_S)
            }
            // Minimum jerk: peak speed 15/8 of the mean, peak acceleration 5.77 times distance over
            // time squared.
            Self::Steps(amplitude) => {
                let way = 2.0 * amplitude.to_radians();
                (amplitude.to_radians(), 1.875 * way / RISE_S, 5.78 * way / (RISE_S * RISE_S))
            }
        }
    }

    /// Position about the middle (rad), speed and acceleration at a time.
    fn reference(self, time_s: f64) -> (f64, f64, f64) {
        match self {
            Self::Sine(amplitude, frequency) => {
                let (amplitude, omega) =
                    (amplitude.to_radians() * (time_s / FADE_S).min(1.0), TAU * frequency);
                let (sine, cosine) = (omega * time_s).sin_cos();
                (amplitude * sine, amplitude * omega * cosine, -amplitude * omega * omega * sine)
            }
            Self::Triangle(amplitude, speed) => {
                let (amplitude, speed) = (amplitude.to_radians(), speed.to_radians());
                // From the middle upward.
                let way = speed * time_s + amplitude;
                let place = way.rem_euclid(4.0 * amplitude);
                match place < 2.0 * amplitude {
                    true => (place - amplitude, speed, 0.0),
                    false => (3.0 * amplitude - place, -speed, 0.0),
                }
            }
            Self::Steps(amplitude) => {
                let amplitude = amplitude.to_radians();
                let each = RISE_S + DWELL_S;
                let (turn, share) = ((time_s / each).floor(), ((time_s % each) / RISE_S).min(1.0));
                let to = if turn % 2.0 == 0.0 { amplitude } else { -amplitude };
                let from = if turn == 0.0 { 0.0 } else { -to };
                let (s, way) = (share, to - from);
                let position = from + way * s * s * s * (10.0 - 15.0 * s + 6.0 * s * s);
                let velocity = way / RISE_S * 30.0 * s * s * (1.0 - s) * (1.0 - s);
                let acceleration = way / (RISE_S * RISE_S) * 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s);
                (position, velocity, acceleration)
            }
        }
    }

    /// Returns a description.
    pub(super) fn words(self) -> String {
        match self {
            Self::Sine(amplitude, frequency) => {
                format!("a sine of {amplitude}° and {frequency} Hz")
            }
            Self::Triangle(amplitude, speed) => format!("a triangle of {amplitude}° at {speed}°/s"),
            Self::Steps(amplitude) => format!("steps between ±{amplitude}°"),
        }
    }

    /// Whether two movements are of one kind.
    pub(super) fn is_like(self, other: Self) -> bool {
        std::mem::discriminant(&self) == std::mem::discriminant(&other)
    }

    /// Its segments, about the middle (°).
    fn segments(self, middle: f64) -> String {
        let label = self.words();
        match self {
            Self::Sine(amplitude, frequency) => format!(
                "[[segments]]\nkind = \"multisine\"\nlabel = \"{label}\"\nfrequencies_hz = \
                 [{frequency:?}]\namplitudes_deg = [{amplitude:?}]\n\
                 centre_deg = {middle:?}\nduration_s = {PLAYED_S:?}\nfade_in_s = {FADE_S:?}\n\n"
            ),
            Self::Triangle(amplitude, speed) => {
                let strokes = (PLAYED_S / self.stroke_s()).ceil().max(4.0) as usize;
                let duration = self.stroke_s() + EASE_S;
                let stroke = |at: usize| {
                    let position =
                        middle + if at.is_multiple_of(2) { amplitude } else { -amplitude };
                    format!(
                        "[[segments]]\nkind = \"ramp\"\nlabel = \"{label}\"\nposition_deg = \
                         {position:?}\nspeed_deg_s = {speed:?}\nease_s = \
                         {EASE_S:?}\nduration_s = {duration:?}\n\n"
                    )
                };
                (0..strokes).map(stroke).collect()
            }
            Self::Steps(amplitude) => {
                let count = (PLAYED_S / (RISE_S + DWELL_S)).round() as usize;
                let positions: Vec<String> = (0..count)
                    .map(|at| {
                        format!(
                            "{:?}",
                            middle + if at.is_multiple_of(2) { amplitude } else { -amplitude }
                        )
                    })
                    .collect();
                format!(
                    "[[segments]]\nkind = \"steps\"\nlabel = \"{label}\"\npositions_deg = [{}]\n\
                     rise_s = {RISE_S:?}\ndwell_s = {DWELL_S:?}\n\n",
                    positions.join(", ")
                )
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rig::protocol::Protocol;

    fn rig() -> RigFile {
        RigFile::load(concat!(env!("CARGO_MANIFEST_DIR"), "/../../launch/rigs/hydrostatic.toml"))
            .unwrap()
    }

    #[test]
    fn every_movement_is_a_protocol_that_the_rig_plays() {
        let rig = rig();
        let capability = RigCapability::of(&rig, 0).unwrap();
        let all = Movement::all(&capability);
        assert!(all.len() > 15, "{all:?}");
        assert!(!all.contains(&Movement::Sine(60.0, 8.0)), "60° at 8 Hz are beyond any motor");
        for movement in all {
            let text = capability.protocol("trial", "one trial", &[movement]);
            let protocol = Protocol::parse(&text, "trial.toml")
                .unwrap_or_else(|error| panic!("{error}\n{text}"));
            protocol.check_against(&rig).unwrap_or_else(|error| panic!("{error}\n{text}"));
            assert!(protocol.duration_s() >= PLAYED_S, "{} s", protocol.duration_s());
        }
    }

    #[test]
    fn a_protocol_moves_the_axis_that_is_identified() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../launch/rigs/two-axis.toml");
        let rig = RigFile::load(path).unwrap();
        let movements = [Movement::Sine(20.0, 1.0), Movement::Triangle(20.0, 60.0)];
        for axis in [0, 1] {
            let capability = RigCapability::of(&rig, axis).unwrap();
            let text = capability.protocol("trial", "two movements", &movements);
            let protocol = Protocol::parse(&text, "trial.toml").unwrap();
            protocol.check_against(&rig).unwrap_or_else(|error| panic!("{error}\n{text}"));
            assert!(protocol.segments.iter().all(|segment| segment.axis == axis), "{text}");
        }
        assert!(RigCapability::of(&rig, 2).is_none());
    }

    #[test]
    fn references_are_consistent_derivatives_and_the_model_follows() {
        let rig = rig();
        let capability = RigCapability::of(&rig, 0).unwrap();
        for movement in
            [Movement::Sine(20.0, 1.0), Movement::Triangle(20.0, 60.0), Movement::Steps(10.0)]
        {
            let h = 1e-5;
            for time in [1.21, 1.77, 3.13, 4.6] {
                let (low, now, high) = (
                    movement.reference(time - h),
                    movement.reference(time),
                    movement.reference(time + h),
                );
                assert!(
                    ((high.0 - low.0) / (2.0 * h) - now.1).abs() < 1e-3,
                    "{movement:?} at {time}"
                );
                let acceleration = (high.1 - low.1) / (2.0 * h);
                assert!(
                    (acceleration - now.2).abs() < 1e-2 * (1.0 + now.2.abs()),
                    "{movement:?} at {time}"
                );
            }
            let plant = rig.model.transmission("").unwrap().plant(Vec::new()).unwrap();
            let record = capability.record(movement, plant);
            let reach =
                record.master.iter().fold(0.0f64, |most, position| position.abs().max(most));
            let amplitude = movement.peaks().0;
            assert!(
                (0.7..1.5).contains(&(reach / amplitude)),
                "{movement:?}: {reach} rad of {amplitude}"
            );
        }
    }

    #[test]
    fn a_rig_without_a_plant_has_no_candidate_movements() {
        let emps =
            RigFile::load(concat!(env!("CARGO_MANIFEST_DIR"), "/../../launch/rigs/emps.toml"))
                .unwrap();
        assert!(RigCapability::of(&emps, 0).is_none());
    }
}

//! The control law of guided movements (§ 4.1): proportional and derivative feedback of the
//! position error, with feed-forward of inertia and friction (fig. 4.3A). Pure: time, sample and
//! setpoint are arguments.
//!
//! **Bumpless transfer.** Without power the law tracks the hand: its reference is the measured
//! position, its output 0 V. When power comes, and whenever the target changes discontinuously
//! (another mode or owner, an expired lease, a jump), the reference continues from its present
//! position and velocity, comes to rest relative to the new target, and approaches it by a
//! minimum-jerk movement in `ramp_s`, or longer if the distance is long. From one step to the next
//! the output therefore changes by at most [`Law::step_bound_v`], plus the feedback of the hand's
//! actual motion.
//!
//! **Options** ([`rig::ControlOptions`]). Friction compensation from the declared model instead of
//! the printed triangle, a disturbance observer, and an outer loop on the slave that shifts the
//! master's reference. `reference_position` of the command is then the master's reference, not the
//! slave's. A search for the stops, and an axis that is not homed, have none of them: there the
//! feed-forward is the printed one, or none.
//!
//! **Force control.** In [`Mode::Impedance`] and [`Mode::Rhythm`] the machine moves with the hand
//! ([`force_law`]); the thesis's IMPEDENCE, a sine under position control, is [`Mode::Position`]
//! here. Transfer between position control with its options, position control without, and force
//! control is bumpless: the difference fades within [`AUTHORITY_S`].
//!
//! **Late answers.** A loop that is kept from answering in time reduces its feedback ([`latency`]).
//!
//! **Limits.** A setpoint may lower the limit on the output (module `output_limit`); in
//! [`Mode::Initialise`] the reference then stays within what that output can hold.
//!
//! **Homing.** While an axis is unhomed ([`Sample::homed`]), its output and range are those of
//! homing. When positions begin to count from another zero, the law starts again from the measured
//! position, and follows no setpoint that was given in the old ones.
//!
//! **No setpoint.** Without a setpoint, or once its lease has expired, the law brings the reference
//! to rest and holds it. [`Mode::Passive`] ramps the output to 0 V within [`AUTHORITY_S`]. A
//! measured value that is not finite gives 0 V on all axes at once, reported by `limited` and mode
//! passive.
//!
//! The law is odd: mirrored inputs give mirrored outputs. The loop's rate (500 Hz, 1 kHz) affects
//! the sampling only.

mod compensation;
mod config;
mod controller;
mod feedforward;
pub mod field;
mod force_control;
pub mod force_law;
pub mod latency;
mod observer;
mod output_limit;
mod position_control;
mod position_options;
mod saturation;
mod slave_loop;
mod transition;
mod velocity_estimate;

pub use config::{AxisLaw, LawConfig, STOP_S};
use controller::Controller;
use feedforward::Slew;
pub use feedforward::{REVERSAL, friction};
use ipc_types::{AXES, Mode, MotorCommand, Sample, Setpoint};
use latency::Latency;
pub use observer::OBSERVER_SLEW_S;
use position_options::{OptionState, sanitised};
use rig::ACCELERATION_HZ;
use saturation::within;
use transition::{Motion, Transition, stopping_displacement};
use velocity_estimate::VelocityEstimate;

/// Time in which the output gains or loses its full authority (s).
pub const AUTHORITY_S: f64 = 0.05;
/// Time in which the friction feed-forward may change by its peak value (s).
pub const FRICTION_SLEW_S: f64 = 0.01;
/// Time in which the inertia feed-forward may change by the output limit (s).
pub const INERTIA_SLEW_S: f64 = 0.02;
/// A step of the target counts as a change of target if the feedback's response to it would exceed
/// this (V).
pub const SWITCH_STEP_V: f64 = 0.05;
/// Longest time over which a setpoint is extrapolated (s).
pub const EXTRAPOLATION_S: f64 = 0.1;
/// Longest elapsed time that one step accounts for, however late the loop is (s).
const LONGEST_STEP_S: f64 = 0.05;

/// Who sets the reference; a change begins a transition.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Source {
    /// The law itself: it holds.
    Own,
    /// The hand, under force control.
    Hand,
    /// A setpoint.
    Setpoint { incarnation: u64, protocol: u64, owner: u8, mode: u8 },
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Axis {
    velocity: VelocityEstimate,
    reference: Motion,
    target: Motion,
    /// The time that the target is meant for.
    target_ns: u64,
    transition: Option<Transition>,
    friction: Slew,
    inertia: Slew,
    options: OptionState,
    /// Speed of the handle.
    handle: VelocityEstimate,
    /// Its acceleration: a low-pass filtered difference quotient of that speed.
    acceleration: VelocityEstimate,
    /// Output of the force control, eq. 4.2.1 (V).
    force_v: f64,
    /// Whose output the last one was.
    controller: Controller,
    /// The last output before scaling by the authority (V), and the part of another controller's
    /// output that bumpless transfer still adds.
    output_v: f64,
    carried_v: f64,
    /// Limit on the output (V), and whether anti-windup held the reference back.
    limit_v: f64,
    held_back: bool,
    /// Largest distance of the reference from the measured position (rad or m).
    lead: f64,
    /// Whether its positions are absolute.
    homed: bool,
}

/// The control law; the module's documentation describes it. Two that are equal give the same
/// output from then on, to the last bit.
#[derive(Clone, Debug, PartialEq)]
pub struct Law {
    config: LawConfig,
    axis: [Axis; AXES],
    /// Who sets the reference; `None` while it tracks the hand.
    source: Option<Source>,
    /// 0 (no output) to 1.
    authority: f64,
    last_step_ns: Option<u64>,
    last_sample_ns: u64,
    /// The zeros that positions count from.
    homing_sequence: u64,
    latency: Latency,
}

impl Law {
    /// Creates a law without a history. A limit that is not a positive number counts as 0.
    pub fn new(mut config: LawConfig) -> Self {
        config.axes = config.axes.min(AXES);
        for law in &mut config.axis {
            let control = &mut law.control;
            let feedforward = &mut control.feedforward;
            for limit in [
                &mut control.output_limit_v,
                &mut feedforward.friction_peak_v,
                &mut feedforward.friction_floor_v,
            ] {
                *limit = if limit.is_finite() { limit.max(0.0) } else { 0.0 };
            }
            control.options = sanitised(control.options);
        }
        Self {
            config,
            axis: config.axis.map(|axis| Axis {
                velocity: VelocityEstimate::new(axis.control.velocity_filter_hz),
                handle: VelocityEstimate::new(axis.control.velocity_filter_hz),
                acceleration: VelocityEstimate::new(ACCELERATION_HZ),
                lead: f64::INFINITY,
                ..Axis::default()
            }),
            source: None,
            authority: 0.0,
            last_step_ns: None,
            last_sample_ns: 0,
            homing_sequence: 0,
            latency: Latency::default(),
        }
    }

    /// Largest change of an axis's output in a step of `period_s` while the hand rests, for any
    /// change of setpoint, mode or lease between power on and power off (V). The movement of the
    /// reference itself adds `period_s` · (position gain · velocity + velocity gain ·
    /// acceleration); an answer later than [`latency::TOLERATED_S`] adds at most the feedback times
    /// `period_s / AUTHORITY_S`.
    pub fn step_bound_v(&self, axis: usize, period_s: f64) -> f64 {
        let law = &self.config.axis[axis];
        SWITCH_STEP_V
            + period_s
                * (3.0 * law.control.output_limit_v / AUTHORITY_S
                    + law.control.output_limit_v / INERTIA_SLEW_S)
            + law.options_step_v(period_s)
    }

    /// Computes one cycle. `powered`: the sample shows the gate open for the epoch of the newest
    /// token.
    ///
    /// The loop fills in the identity, `token_sequence`, `epoch`, `cycles_missed` and `profile` of
    /// the command.
    pub fn step(
        &mut self,
        now_ns: u64,
        sample: &Sample,
        setpoint: Option<&Setpoint>,
        powered: bool,
    ) -> MotorCommand {
        let elapsed_s = self
            .last_step_ns
            .map_or(self.config.period_s, |last| now_ns.saturating_sub(last) as f64 * 1e-9)
            .clamp(0.0, LONGEST_STEP_S);
        self.last_step_ns = Some(now_ns);
        let age_s = now_ns.saturating_sub(sample.scan_time_ns) as f64 * 1e-9;
        self.latency.update(age_s, elapsed_s, elapsed_s / AUTHORITY_S);
        let mut command = MotorCommand {
            sample_tick: sample.tick,
            sample_time_ns: sample.scan_time_ns,
            computed_ns: now_ns,
            axes: self.config.axes as u8,
            feedback_factor: self.latency.feedback_factor,
            mode: Mode::Passive.code(),
            ..MotorCommand::default()
        };
        if !self.observe(sample) {
            command.limited = 1;
            return command;
        }
        let axes = self.config.axes;
        let time_ns = sample.scan_time_ns;
        let live = setpoint.filter(|setpoint| {
            now_ns <= setpoint.lease_until_ns
                && usable(setpoint, time_ns, axes)
                && (setpoint.homing_sequence == sample.homing_sequence
                    || setpoint.mode == Mode::Passive.code())
        });
        command.lapsed = u8::from(setpoint.is_some() && live.is_none());
        command.setpoint_sequence = live.map_or(0, |setpoint| setpoint.sequence);
        let mode = live
            .map_or(Mode::Hold, |setpoint| Mode::from_code(setpoint.mode).unwrap_or(Mode::Hold));
        for (index, (axis, law)) in
            self.axis.iter_mut().zip(&self.config.axis).enumerate().take(axes)
        {
            axis.limit_output(law, live, index, self.source.is_none(), elapsed_s);
        }

        if mode.is_force_controlled() && !self.has_force_control(sample) {
            // Force control needs a measured torque.
            self.release_output();
            command.limited = 1;
        } else if !powered || (mode == Mode::Passive && self.authority == 0.0) {
            self.release_output();
        } else {
            let wanted = if mode == Mode::Passive { 0.0 } else { 1.0 };
            self.authority +=
                (wanted - self.authority).clamp(-elapsed_s / AUTHORITY_S, elapsed_s / AUTHORITY_S);
            if mode.is_force_controlled() {
                self.source = Some(Source::Hand);
            } else {
                self.choose_reference(time_ns, sample, live, mode, axes, elapsed_s);
            }
            command.mode = mode.code();
        }
        self.compute_outputs(sample, live, elapsed_s, &mut command);
        command
    }

    /// Updates the velocity estimates. Returns false, and releases the output, if the position of
    /// an axis is missing or not finite.
    fn observe(&mut self, sample: &Sample) -> bool {
        let axes = self.config.axes;
        let measured = (0..axes).all(|axis| {
            sample.master_position[axis].is_finite() && sample.master_present & (1 << axis) != 0
        });
        if !measured {
            self.release_output();
            self.axis.iter_mut().for_each(Axis::forget_positions);
            return false;
        }
        let time_ns = sample.scan_time_ns;
        if time_ns < self.last_sample_ns {
            // Another acquisition process has taken over: start again from the measured position.
            self.release_output();
        }
        if sample.homing_sequence != self.homing_sequence {
            // Positions count from another zero: what is remembered of them means nothing now.
            self.homing_sequence = sample.homing_sequence;
            self.release_output();
            self.axis.iter_mut().for_each(Axis::forget_positions);
        }
        self.last_sample_ns = time_ns;
        for (index, axis) in self.axis.iter_mut().enumerate().take(axes) {
            axis.homed = sample.homed & 1 << index != 0;
            axis.velocity.update(time_ns, sample.master_position[index]);
            let speed = axis.handle.update(time_ns, handle_position(sample, index));
            axis.acceleration.update(time_ns, speed);
        }
        true
    }

    /// Writes the outputs of all axes into the command. If a value is not finite, releases every
    /// axis.
    fn compute_outputs(
        &mut self,
        sample: &Sample,
        live: Option<&Setpoint>,
        elapsed_s: f64,
        command: &mut MotorCommand,
    ) {
        let mut finite = true;
        for axis in 0..self.config.axes {
            finite &= match (self.source, live) {
                (Some(Source::Hand), Some(setpoint)) => {
                    self.control_force(axis, sample, setpoint, elapsed_s, command)
                }
                _ => self.control_position(axis, sample, live, elapsed_s, command),
            };
        }
        if !finite {
            self.release_output();
            command.volts = [0.0; AXES];
            command.feedforward_v = [0.0; AXES];
            command.reference_position = [0.0; AXES];
            command.reference_velocity = [0.0; AXES];
            command.mode = Mode::Passive.code();
            command.limited = 1;
        }
    }

    /// Sets the output to zero; from then on the reference tracks the hand.
    fn release_output(&mut self) {
        self.source = None;
        self.authority = 0.0;
        for axis in &mut self.axis {
            axis.transition = None;
            axis.release();
            axis.friction.reset();
            axis.inertia.reset();
            axis.options.reset();
            axis.forget();
        }
    }

    /// Determines the target of each axis, and begins a transition if it has changed
    /// discontinuously.
    fn choose_reference(
        &mut self,
        time_ns: u64,
        sample: &Sample,
        live: Option<&Setpoint>,
        mode: Mode,
        axes: usize,
        elapsed_s: f64,
    ) {
        let source = match live {
            Some(setpoint) if mode != Mode::Passive => Source::Setpoint {
                incarnation: setpoint.incarnation,
                protocol: setpoint.protocol,
                owner: setpoint.owner,
                mode: setpoint.mode,
            },
            _ => Source::Own,
        };
        let begins = matches!(self.source, None | Some(Source::Hand));
        let changed = self.source != Some(source);
        self.source = Some(source);
        for (index, axis) in self.axis.iter_mut().enumerate().take(axes) {
            let law = &self.config.axis[index];
            let position = sample.master_position[index];
            let reference = axis.present_reference(time_ns);
            if begins || !reference.is_finite() {
                // Power has come on: start from the hand's own motion, so that there is no initial
                // error.
                let speed = law.catch_up_speed().abs();
                let velocity = within(axis.velocity.velocity(), speed);
                axis.reference = Motion { position, velocity, acceleration: 0.0 };
                axis.transition = None;
            } else {
                axis.reference = reference;
            }
            // The search begins where the outer loop on the slave had brought the master.
            let shifts = Controller::of(mode, axis.homed) == Controller::Search;
            let shift = if shifts { axis.options.slave.take() } else { Motion::default() };
            axis.reference = axis.reference.plus(&shift);
            let target = match (source, live) {
                (Source::Setpoint { .. }, Some(setpoint))
                    if setpoint.position[index].is_finite() =>
                {
                    target_of(setpoint, index, mode, time_ns)
                }
                _ if changed => axis.resting_place(law),
                _ => axis.target_at(time_ns),
            };
            let step = target.minus(&axis.target_at(time_ns));
            let jumps = law.control.position_gain.abs() * step.position.abs()
                + law.control.velocity_gain.abs() * step.velocity.abs()
                > SWITCH_STEP_V;
            if changed || jumps || shift.position != 0.0 {
                let offset = axis.reference.minus(&target);
                let speed = law.catch_up_speed();
                let ramps = law.control.ramp_s > 0.0
                    && law.control.ramp_s.is_finite()
                    && speed > 0.0
                    && offset.is_finite();
                axis.transition = ramps.then(|| {
                    Transition::new(time_ns, &offset, law.stop_s(), law.control.ramp_s, speed)
                });
            }
            axis.target = target;
            axis.target_ns = time_ns;
            let offset = axis.transition.and_then(|transition| transition.at(time_ns));
            if offset.is_none() {
                axis.transition = None;
            }
            axis.reference = target.plus(&offset.unwrap_or_default());
            axis.hold_back(law, position, mode == Mode::Initialise, elapsed_s);
        }
    }
}

impl Axis {
    /// Sets the reference to the measured position (rad or m), at rest.
    fn rest_at(&mut self, position: f64, time_ns: u64) {
        self.reference = Motion::at_rest(position);
        self.target = self.reference;
        self.target_ns = time_ns;
    }

    /// The last target, extrapolated to a time.
    fn target_at(&self, time_ns: u64) -> Motion {
        self.target.extrapolated(time_ns.saturating_sub(self.target_ns) as f64 * 1e-9)
    }

    /// The reference at a time, from target and transition.
    fn reference_at(&self, time_ns: u64) -> Motion {
        self.target_at(time_ns).plus(
            &self.transition.and_then(|transition| transition.at(time_ns)).unwrap_or_default(),
        )
    }

    /// The position, within the limits, at which a moving reference comes to rest at constant
    /// deceleration.
    fn resting_place(&self, law: &AxisLaw) -> Motion {
        let displacement = stopping_displacement(self.reference.velocity, law.stop_s());
        let (lowest, highest) = law.position_range(self.homed);
        Motion::at_rest((self.reference.position + displacement).max(lowest).min(highest))
    }

    /// Forgets every measured position.
    fn forget_positions(&mut self) {
        self.velocity.reset();
        self.handle.reset();
        self.acceleration.reset();
    }
}

/// Position of the handle by its own encoder, or by the motor's if there is none (rad or m).
fn handle_position(sample: &Sample, axis: usize) -> f64 {
    let slave = sample.slave_position[axis];
    if sample.slave_present & (1 << axis) != 0 && slave.is_finite() {
        slave
    } else {
        sample.master_position[axis]
    }
}

/// Whether a setpoint can be followed. In position mode all numbers of the rig's axes must be
/// finite, and a moving target is extrapolated by at most [`EXTRAPOLATION_S`]. A hold needs no
/// position; a force field needs all its numbers.
fn usable(setpoint: &Setpoint, time_ns: u64, axes: usize) -> bool {
    if Mode::from_code(setpoint.mode).is_some_and(Mode::is_force_controlled) {
        return field::is_finite(setpoint);
    }
    let near = time_ns.abs_diff(setpoint.at_ns) as f64 * 1e-9 <= EXTRAPOLATION_S;
    (0..axes).all(|axis| {
        let (velocity, acceleration) = (setpoint.velocity[axis], setpoint.acceleration[axis]);
        let rests = velocity == 0.0 && acceleration == 0.0;
        !Mode::from_code(setpoint.mode).is_some_and(Mode::moves)
            || (setpoint.position[axis].is_finite()
                && velocity.is_finite()
                && acceleration.is_finite()
                && (near || rests))
    })
}

/// The target of a setpoint at the time of a sample.
fn target_of(setpoint: &Setpoint, axis: usize, mode: Mode, time_ns: u64) -> Motion {
    if !mode.moves() {
        return Motion::at_rest(setpoint.position[axis]);
    }
    let ahead_s = (i128::from(time_ns) - i128::from(setpoint.at_ns)) as f64 * 1e-9;
    Motion {
        position: setpoint.position[axis],
        velocity: setpoint.velocity[axis],
        acceleration: setpoint.acceleration[axis],
    }
    .extrapolated(ahead_s.clamp(-EXTRAPOLATION_S, EXTRAPOLATION_S))
}

//! The rig without a clock: the control law of the rig on its simulated card, in lock step, as fast
//! as the processor goes.
//!
//! Nothing here is a copy: [`control::law::Law`] with the rig file's gains,
//! [`acquisition::Converter`] with its channel map, and [`simulator::LockStepDaq`], which is the
//! card of the simulator process. What the processes add (shared memory, gate, watchdog, lateness)
//! is left out; the motor has power from the first cycle on.
//!
//! In each cycle control sees the newest scan, and the volts that answer it are at the motor
//! [`ANSWER_TICKS`] card periods later, as on the time grid of the processes.
//!
//! ```
//! use twin::{Aim, Twin};
//! let rig = rig::RigFile::parse(include_str!("../../../launch/rigs/hydrostatic.toml"), "hydrostatic.toml")?;
//! let mut twin = Twin::new(&rig, &[])?;
//! for _ in 0..100 {
//!     let setpoint = twin.setpoint(&Aim::at_rest(0.0));
//!     let moment = twin.cycle(&setpoint)?;
//!     assert!(moment.sample.master_position[0].abs() < 0.01);
//! }
//! assert_eq!(twin.time_s(), 0.2);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used))]

pub mod free;
pub mod guided;
pub mod learning;

use std::collections::VecDeque;

use acquisition::Converter;
use control::law::{Law, LawConfig};
use ipc_types::{AXES, Mode, MotorCommand, Sample, Setpoint};
use plant::transmission::Motion;
use rig::{ChannelKind, RigFile};
use runtime::daq::{Daq, DaqError};
use simulator::{CardError, LockStepDaq};
use thiserror::Error;

/// Periods of the card from a scan to the volts that answer it: through control and the gate, about
/// 1 ms at 2 kHz.
pub const ANSWER_TICKS: u64 = 2;
/// The first scan that control sees: the enable line has had its two edges, so the motor has power.
const FIRST_TICK: u64 = 3;
/// How long the card is patient without an edge of the enable line, which toggles by itself here
/// (ns).
const LINE_NS: u64 = 5_000_000;
/// How long a setpoint of [`Twin::setpoint`] may be followed (ns).
const LEASE_NS: u64 = 100_000_000;
/// Identity of the one who makes the setpoints.
const INCARNATION: u64 = 61;

/// The rig without what no law sees and no figure shows: EMG, trigger and other channels, and the
/// hard stops at the handle, which the thesis's simulations do not have. A scan then takes less
/// than half the time, and all else stays as it was, noise included.
#[must_use]
pub fn lean(mut rig: RigFile) -> RigFile {
    rig.channels.retain(|channel| channel.kind == ChannelKind::Torque);
    rig.simulation.end_stops = None;
    rig
}

/// Why there is no twin, or why it stopped.
#[derive(Debug, Error)]
pub enum TwinError {
    /// The rig file has no plant that can be simulated, or an effect or constant is out of range.
    #[error(transparent)]
    Card(#[from] CardError),
    /// The simulated card refused (volts that are not finite).
    #[error(transparent)]
    Daq(#[from] DaqError),
    /// The rates of the rig do not divide; a rig that was read from a file has been checked for
    /// this.
    #[error(
        "acquisition at {acquisition_hz} Hz and control at {control_hz} Hz: expected a multiple; change `rates`"
    )]
    Rates {
        /// Rate of acquisition (Hz).
        acquisition_hz: u32,
        /// Rate of control (Hz).
        control_hz: u32,
    },
}

/// Where the master of an axis shall be, in the handle's coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Aim {
    /// Position (rad or m).
    pub position: f64,
    /// Velocity (rad/s or m/s).
    pub velocity: f64,
    /// Acceleration (rad/s² or m/s²).
    pub acceleration: f64,
    /// Peak speed of the movement that this is part of, which gives the friction feed-forward its
    /// shape; 0 for none (rad/s or m/s).
    pub peak_speed: f64,
}

impl Aim {
    /// Rest at a position (rad or m).
    pub const fn at_rest(position: f64) -> Self {
        Self { position, velocity: 0.0, acceleration: 0.0, peak_speed: 0.0 }
    }

    /// A sine that passes through 0 upwards at time 0: amplitude (rad or m), frequency (Hz), time
    /// (s).
    pub fn sine(amplitude: f64, hertz: f64, time_s: f64) -> Self {
        let omega = std::f64::consts::TAU * hertz;
        let (sine, cosine) = (omega * time_s).sin_cos();
        Self {
            position: amplitude * sine,
            velocity: amplitude * omega * cosine,
            acceleration: -amplitude * omega * omega * sine,
            peak_speed: (amplitude * omega).abs(),
        }
    }
}

/// One cycle of control.
#[derive(Clone, Copy, Debug)]
pub struct Moment {
    /// Time of the scan since the first cycle's (s).
    pub time_s: f64,
    /// What control saw.
    pub sample: Sample,
    /// What it answered.
    pub command: MotorCommand,
    /// Where the first axis of the plant truly was at the scan; the master's position and speed are
    /// the handle's, through the gear.
    pub motion: Motion,
    /// The same of every axis; all zero where the rig has no such axis.
    pub motions: [Motion; AXES],
}

/// The rig without a clock.
#[derive(Debug)]
pub struct Twin {
    daq: LockStepDaq,
    converter: Converter,
    law: Law,
    /// Volts that are on their way, with the tick after which they are at the motor.
    under_way: VecDeque<(u64, [f64; AXES])>,
    axes: u8,
    gears: [f64; AXES],
    acquisition_hz: u32,
    cycle_ticks: u64,
    cycle: u64,
    tick: u64,
}

impl Twin {
    /// A rig at rest at 0. `effects` are `ID[@SITE][=SIZE]`, as for `farreach up --effect`: they go
    /// into the plant, and neither law nor model is told of them.
    ///
    /// # Errors
    /// [`TwinError::Card`], [`TwinError::Rates`].
    pub fn new(rig: &RigFile, effects: &[String]) -> Result<Self, TwinError> {
        let (acquisition_hz, control_hz) = (rig.rates.acquisition_hz, rig.rates.control_hz);
        let whole =
            acquisition_hz > 0 && control_hz > 0 && acquisition_hz.is_multiple_of(control_hz);
        if !whole {
            return Err(TwinError::Rates { acquisition_hz, control_hz });
        }
        let mut gears = [1.0; AXES];
        for (gear, axis) in gears.iter_mut().zip(&rig.axes) {
            *gear = axis.master.turns_per_handle_turn;
        }
        Ok(Self {
            daq: LockStepDaq::new(rig, effects, LINE_NS, true)?,
            converter: Converter::new(rig),
            law: Law::new(LawConfig::of_rig(rig)),
            under_way: VecDeque::with_capacity(ANSWER_TICKS as usize + 1),
            axes: rig.axes.len() as u8,
            gears,
            acquisition_hz,
            cycle_ticks: u64::from(acquisition_hz / control_hz),
            cycle: 0,
            tick: 0,
        })
    }

    /// Time of the scan that the next cycle will see, since the first cycle's (s).
    pub fn time_s(&self) -> f64 {
        (self.cycle * self.cycle_ticks) as f64 / f64::from(self.acquisition_hz)
    }

    /// Time of the same scan on the card's clock (ns).
    pub fn scan_ns(&self) -> u64 {
        let period_ns = 1_000_000_000 / u64::from(self.acquisition_hz);
        self.daq.now_ns() + (self.next_tick() - self.tick) * period_ns
    }

    /// A setpoint in position mode for the next cycle; axes other than the first are to be at 0.
    pub fn setpoint(&self, aim: &Aim) -> Setpoint {
        self.setpoint_of(std::slice::from_ref(aim))
    }

    /// A setpoint in position mode for the next cycle, an aim for each axis; axes without one are
    /// to be at 0.
    pub fn setpoint_of(&self, aims: &[Aim]) -> Setpoint {
        let at_ns = self.scan_ns();
        let mut setpoint = Setpoint {
            incarnation: INCARNATION,
            at_ns,
            lease_until_ns: at_ns + LEASE_NS,
            mode: Mode::Position.code(),
            axes: self.axes,
            ..Setpoint::default()
        };
        for (axis, aim) in aims.iter().enumerate().take(AXES) {
            setpoint.position[axis] = aim.position;
            setpoint.velocity[axis] = aim.velocity;
            setpoint.acceleration[axis] = aim.acceleration;
            setpoint.peak_speed[axis] = aim.peak_speed;
        }
        setpoint
    }

    /// One cycle of control: the plant runs to the next scan, control answers it. Sleeps never and
    /// allocates nothing.
    ///
    /// # Errors
    /// [`TwinError::Daq`].
    pub fn cycle(&mut self, setpoint: &Setpoint) -> Result<Moment, TwinError> {
        self.answer(Some(setpoint), true)
    }

    /// The same cycle where there may be no setpoint, and where control may be told that it has no
    /// power, as on the rig before somebody enables it.
    ///
    /// # Errors
    /// [`TwinError::Daq`].
    pub fn answer(
        &mut self,
        setpoint: Option<&Setpoint>,
        powered: bool,
    ) -> Result<Moment, TwinError> {
        let time_s = self.time_s();
        let scan_tick = self.next_tick();
        self.run_to(scan_tick - 1)?;
        let card = self.daq.card();
        let mut motions = std::array::from_fn(|axis| card.motion_of(axis));
        for (motion, gear) in motions.iter_mut().zip(self.gears) {
            motion.master_position_rad /= gear;
            motion.master_velocity_rad_s /= gear;
        }
        self.run_to(scan_tick)?;
        let now_ns = self.daq.now_ns();
        let sample = match self.daq.read_due(now_ns)?.last() {
            Some(scan) => self.converter.convert(scan),
            // Every tick makes a scan. Were there none, the law would let go, as it does on the
            // rig.
            None => Sample::default(),
        };
        let command = self.law.step(now_ns, &sample, setpoint, powered);
        // At the motor when the card takes the scan that many ticks later: written after the one
        // before it.
        self.under_way.push_back((self.tick + ANSWER_TICKS - 1, command.volts));
        self.cycle += 1;
        Ok(Moment { time_s, sample, command, motion: motions[0], motions })
    }

    /// The tick at which control's next scan is taken.
    fn next_tick(&self) -> u64 {
        FIRST_TICK + self.cycle * self.cycle_ticks
    }

    fn run_to(&mut self, tick: u64) -> Result<(), TwinError> {
        while self.tick < tick {
            if let Some(&(due, volts)) = self.under_way.front()
                && due <= self.tick
            {
                self.under_way.pop_front();
                self.daq.write(volts)?;
            }
            self.daq.advance(1);
            self.tick += 1;
        }
        Ok(())
    }
}

//! The rig without a clock: control law, conversion and simulated card, stepped in lock-step, as
//! fast as the processor allows.
//!
//! Runs the code of the processes: [`control::law::Law`] with the rig file's gains,
//! [`acquisition::Converter`] with its channel map, and [`simulator::LockStepDaq`], the card of the
//! simulator process. Shared memory, gate, watchdog and jitter are left out; the motor has power
//! from the first cycle on.
//!
//! In each cycle control receives the newest scan; its output reaches the motor
//! [`OUTPUT_DELAY_TICKS`] card periods later, as on the time grid of the processes.
//!
//! ```
//! use lock_step::{Aim, LockStepRig};
//! let text = include_str!("../../../launch/rigs/hydrostatic.toml");
//! let rig = rig::RigFile::parse(text, "hydrostatic.toml")?;
//! let mut system = LockStepRig::new(&rig, &[])?;
//! for _ in 0..100 {
//!     let setpoint = system.setpoint(&Aim::at_rest(0.0));
//!     let moment = system.cycle(&setpoint)?;
//!     assert!(moment.sample.master_position[0].abs() < 0.01);
//! }
//! assert_eq!(system.time_s(), 0.2);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used))]

pub mod free_movement;
pub mod guided;
pub mod ilc;

use std::collections::VecDeque;

use acquisition::Converter;
use acquisition::homing::Homing;
use control::law::{Law, LawConfig};
use ipc_types::{AXES, Mode, MotorCommand, Sample, Setpoint, Zeros};
use plant::transmission::Motion;
use rig::{ChannelKind, RigFile};
use runtime::daq::{Daq, DaqError};
use simulator::{CardError, LockStepDaq};
use thiserror::Error;

/// Card periods from a scan to the output computed from it, through control and gate: about 1 ms at
/// 2 kHz.
pub const OUTPUT_DELAY_TICKS: u64 = 2;
/// The first scan that control sees: the enable line has had its two edges, so the motor has power.
const FIRST_TICK: u64 = 3;
/// Timeout of the card's enable line, which toggles by itself here (ns).
const LINE_NS: u64 = 5_000_000;
/// Lease of a setpoint of [`LockStepRig::setpoint`] (ns).
const LEASE_NS: u64 = 100_000_000;
/// Incarnation in the setpoints.
const INCARNATION: u64 = 61;

/// Removes what neither law nor figures use: EMG, trigger and other channels, and the handle's end
/// stops, which the thesis's simulations do not have. A scan then takes less than half the time;
/// everything else, noise included, stays the same.
#[must_use]
pub fn simplified(mut rig: RigFile) -> RigFile {
    rig.channels.retain(|channel| channel.kind == ChannelKind::Torque);
    rig.simulation.end_stops = None;
    rig
}

/// Why the lock-step rig cannot be created or continued.
#[derive(Debug, Error)]
pub enum LockStepError {
    /// The rig file has no plant that can be simulated, or an effect or constant is out of range.
    #[error(transparent)]
    Card(#[from] CardError),
    /// The simulated card refused (volts that are not finite).
    #[error(transparent)]
    Daq(#[from] DaqError),
    /// The rates of the rig do not divide; a rig that was read from a file has been checked for
    /// this.
    #[error(
        "acquisition at {acquisition_hz} Hz and control at {control_hz} Hz: expected a multiple; \
            change `rates`"
    )]
    Rates {
        /// Rate of acquisition (Hz).
        acquisition_hz: u32,
        /// Rate of control (Hz).
        control_hz: u32,
    },
}

/// Desired motion of an axis's master, in the handle's coordinates.
pub type Aim = rig::protocol::trajectory::Point;

/// The result of a control cycle.
#[derive(Clone, Copy, Debug)]
pub struct CycleResult {
    /// Time of the scan since the first cycle's (s).
    pub time_s: f64,
    /// The sample that control received.
    pub sample: Sample,
    /// The command that control computed.
    pub command: MotorCommand,
    /// True motion of the plant's first axis at the scan; the master's in the handle's coordinates.
    pub motion: Motion,
    /// True motion of every axis; zero for an axis that the rig does not have.
    pub motions: [Motion; AXES],
}

/// The rig without a clock.
#[derive(Debug)]
pub struct LockStepRig {
    daq: LockStepDaq,
    converter: Converter,
    /// The rig begins homed.
    zeros: Zeros,
    law: Law,
    /// Outputs not yet written, each with the tick after which it is due.
    pending: VecDeque<(u64, [f64; AXES])>,
    axes: u8,
    gears: [f64; AXES],
    acquisition_hz: u32,
    cycle_ticks: u64,
    cycle: u64,
    tick: u64,
}

impl LockStepRig {
    /// Creates a rig at rest at 0. `effects` are `ID[@SITE][=SIZE]`, as for `farreach up --effect`:
    /// they change the plant, but not the model that the law uses.
    ///
    /// # Errors
    /// [`LockStepError::Card`], [`LockStepError::Rates`].
    pub fn new(rig: &RigFile, effects: &[String]) -> Result<Self, LockStepError> {
        let (acquisition_hz, control_hz) = (rig.rates.acquisition_hz, rig.rates.control_hz);
        let whole =
            acquisition_hz > 0 && control_hz > 0 && acquisition_hz.is_multiple_of(control_hz);
        if !whole {
            return Err(LockStepError::Rates { acquisition_hz, control_hz });
        }
        let mut gears = [1.0; AXES];
        for (gear, axis) in gears.iter_mut().zip(&rig.axes) {
            *gear = axis.master.turns_per_handle_turn;
        }
        Ok(Self {
            daq: LockStepDaq::new(rig, effects, LINE_NS, true)?,
            converter: Converter::new(rig),
            zeros: *Homing::absolute(rig).zeros(),
            law: Law::new(LawConfig::of_rig(rig)),
            pending: VecDeque::with_capacity(OUTPUT_DELAY_TICKS as usize + 1),
            axes: rig.axes.len() as u8,
            gears,
            acquisition_hz,
            cycle_ticks: u64::from(acquisition_hz / control_hz),
            cycle: 0,
            tick: 0,
        })
    }

    /// Changes the plant while it moves, to that of the rig file with these effects.
    ///
    /// # Errors
    /// [`LockStepError::Card`].
    pub fn change_effects(
        &mut self,
        rig: &RigFile,
        effects: &[String],
    ) -> Result<(), LockStepError> {
        let plant = simulator::plant_of(rig, effects)?;
        self.daq.card().replace_plant(plant);
        Ok(())
    }

    /// Time of the next cycle's scan since the first cycle's (s).
    pub fn time_s(&self) -> f64 {
        (self.cycle * self.cycle_ticks) as f64 / f64::from(self.acquisition_hz)
    }

    /// Time of the same scan on the card's clock (ns).
    pub fn scan_ns(&self) -> u64 {
        let period_ns = 1_000_000_000 / u64::from(self.acquisition_hz);
        self.daq.now_ns() + (self.next_tick() - self.tick) * period_ns
    }

    /// A setpoint in position mode for the next cycle; all axes but the first are at 0.
    pub fn setpoint(&self, aim: &Aim) -> Setpoint {
        self.setpoint_of(std::slice::from_ref(aim))
    }

    /// A setpoint in position mode for the next cycle, one aim per axis; axes without one are at 0.
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

    /// Runs one control cycle with the setpoint of an aim.
    ///
    /// # Errors
    /// [`LockStepError::Daq`].
    pub fn follow(&mut self, aim: &Aim) -> Result<CycleResult, LockStepError> {
        let setpoint = self.setpoint(aim);
        self.cycle(&setpoint)
    }

    /// Runs one control cycle: advances the plant to the next scan, then steps the law. Does not
    /// allocate.
    ///
    /// # Errors
    /// [`LockStepError::Daq`].
    pub fn cycle(&mut self, setpoint: &Setpoint) -> Result<CycleResult, LockStepError> {
        self.cycle_with(Some(setpoint), true)
    }

    /// Runs one control cycle, with no setpoint or with a motor without power, as before an enable.
    ///
    /// # Errors
    /// [`LockStepError::Daq`].
    pub fn cycle_with(
        &mut self,
        setpoint: Option<&Setpoint>,
        powered: bool,
    ) -> Result<CycleResult, LockStepError> {
        self.run_cycle(setpoint, powered, None)
    }

    /// As [`Self::cycle_with`]; `see` is called with every sample since the last cycle, as those
    /// who follow acquisition see them.
    ///
    /// # Errors
    /// [`LockStepError::Daq`].
    pub fn cycle_seeing(
        &mut self,
        setpoint: Option<&Setpoint>,
        powered: bool,
        see: &mut dyn FnMut(&Sample),
    ) -> Result<CycleResult, LockStepError> {
        self.run_cycle(setpoint, powered, Some(see))
    }

    fn run_cycle(
        &mut self,
        setpoint: Option<&Setpoint>,
        powered: bool,
        see: Option<&mut dyn FnMut(&Sample)>,
    ) -> Result<CycleResult, LockStepError> {
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
        let scans = self.daq.read_due(now_ns)?;
        let convert = |scan| self.converter.convert(scan, &self.zeros);
        if let Some(see) = see {
            scans.iter().map(convert).for_each(|sample| see(&sample));
        }
        // There is one: every tick produces a scan. Without, the law would release the output.
        let sample = scans.last().map_or_else(Sample::default, convert);
        let command = self.law.step(now_ns, &sample, setpoint, powered);
        // Written after the scan before the one at which it is to act.
        self.pending.push_back((self.tick + OUTPUT_DELAY_TICKS - 1, command.volts));
        self.cycle += 1;
        Ok(CycleResult { time_s, sample, command, motion: motions[0], motions })
    }

    /// Lets control miss its next cycles: the plant goes on under the volts that were due, then
    /// under those that the card holds.
    ///
    /// # Errors
    /// [`LockStepError::Daq`].
    pub fn miss(&mut self, cycles: u64) -> Result<(), LockStepError> {
        self.cycle += cycles;
        self.run_to(self.next_tick() - 1)?;
        self.daq.read_due(self.daq.now_ns())?;
        Ok(())
    }

    /// The tick of control's next scan.
    fn next_tick(&self) -> u64 {
        FIRST_TICK + self.cycle * self.cycle_ticks
    }

    fn run_to(&mut self, tick: u64) -> Result<(), LockStepError> {
        while self.tick < tick {
            if let Some(&(due, volts)) = self.pending.front()
                && due <= self.tick
            {
                self.pending.pop_front();
                self.daq.write(volts)?;
            }
            self.daq.advance(1);
            self.tick += 1;
        }
        Ok(())
    }
}

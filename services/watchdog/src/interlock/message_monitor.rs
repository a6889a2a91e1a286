//! The newest messages that the interlock saw, and the faults that they show.

use ipc_types::program_flow::{ACQUISITION_CYCLE, CONTROL_CYCLE, signature};
use ipc_types::{AXES, Capabilities, CardKind, Message, MotorCommand, Profile, Sample, TripCause};
use rig::Encoder;

use super::config::{Config, LimitsNow};
use super::faults::FaultSet;
use super::pacing::Pacing;
use super::speed::SpeedWindow;
use super::torque_input::InputMonitor;

/// For `arm`, an axis that moves by fewer counts than this within the speed window is at rest.
const REST_COUNTS: f64 = 3.0;

/// One count of an encoder (rad or m).
fn count(encoder: &Encoder) -> f64 {
    1.0 / encoder.counts_per_unit
}

/// The samples seen.
#[derive(Clone, Debug)]
pub(super) struct SampleMonitor {
    pub(super) newest: Option<Sample>,
    master: [SpeedWindow; AXES],
    slave: [SpeedWindow; AXES],
    pacing: Pacing,
    torque_inputs: [InputMonitor; AXES],
}

impl SampleMonitor {
    pub(super) fn new() -> Self {
        Self {
            newest: None,
            master: [SpeedWindow::new(); AXES],
            slave: [SpeedWindow::new(); AXES],
            pacing: Pacing::default(),
            torque_inputs: [InputMonitor::default(); AXES],
        }
    }

    /// Takes a sample; returns the faults that it shows.
    pub(super) fn observe(&mut self, sample: &Sample, config: &Config) -> FaultSet {
        let mut faults = FaultSet::NONE;
        if sample.session != config.session {
            faults.insert(TripCause::SessionMismatch);
            return faults;
        }
        match &self.newest {
            Some(last) if last.incarnation == sample.incarnation => {
                if sample.sequence <= last.sequence || sample.tick <= last.tick {
                    faults.insert(TripCause::SampleBackwards);
                    return faults;
                }
                faults.insert_if(jumped(last, sample, config), TripCause::EncoderJump);
                faults.insert_if(last.homed & !sample.homed != 0, TripCause::HomingLost);
                if last.homing_sequence != sample.homing_sequence {
                    // Positions count from another zero: they tell no speed together with the old.
                    self.master = [SpeedWindow::new(); AXES];
                    self.slave = [SpeedWindow::new(); AXES];
                }
            }
            Some(_) => {
                faults.insert(TripCause::AcquisitionChanged);
                self.pacing = Pacing::default();
                self.master = [SpeedWindow::new(); AXES];
                self.slave = [SpeedWindow::new(); AXES];
            }
            None => {}
        }
        let expected = signature(ACQUISITION_CYCLE, sample.token_sequence);
        faults.insert_if(sample.flow != expected, TripCause::ProgramFlow);
        let too_fast =
            self.pacing.too_fast(sample.scan_time_ns, config.rates.acquisition_period_ns());
        faults.insert_if(too_fast, TripCause::TooFast);
        for (monitor, input) in self.torque_inputs.iter_mut().zip(&config.torque_inputs) {
            if let Some(input) = input {
                faults.merge(monitor.observe(sample, input));
            }
        }
        faults.merge(measured(sample, config));
        for (axis, entry) in config.axes.iter().enumerate() {
            let slave = entry.slave.as_ref().unwrap_or(&entry.master);
            let speed_max = LimitsNow::of(entry, sample.homed & 1 << axis != 0).speed;
            for (window, position, present, encoder) in [
                (
                    &mut self.master[axis],
                    sample.master_position[axis],
                    sample.master_present,
                    &entry.master,
                ),
                (&mut self.slave[axis], sample.slave_position[axis], sample.slave_present, slave),
            ] {
                if present & (1 << axis) != 0 && position.is_finite() {
                    window.push(sample.scan_time_ns, position);
                    let speed = window.at_least(config.speed_window_ns, count(encoder));
                    let beyond = beyond(speed.unwrap_or(0.0), speed_max);
                    faults.insert_if(beyond, TripCause::SpeedLimit);
                }
            }
        }
        self.newest = Some(*sample);
        faults
    }

    /// Homed axes by the newest sample, one bit each.
    pub(super) fn homed(&self) -> u8 {
        self.newest.as_ref().map_or(0, |sample| sample.homed)
    }

    /// Whether every axis's master is at rest; `None` where its speed is not known.
    pub(super) fn at_rest(&self, config: &Config) -> Option<bool> {
        let mut rest = true;
        for (window, axis) in self.master.iter().zip(&config.axes) {
            let count = count(&axis.master);
            let rest_speed = REST_COUNTS * count / (config.speed_window_ns as f64 / 1e9);
            rest &= window.at_least(config.speed_window_ns, count)? <= rest_speed;
        }
        Some(rest)
    }
}

/// The commands seen.
#[derive(Clone, Debug, Default)]
pub(super) struct CommandMonitor {
    pub(super) newest: Option<MotorCommand>,
    pacing: Pacing,
}

impl CommandMonitor {
    /// Takes a command; returns the faults that it shows.
    pub(super) fn observe(
        &mut self,
        command: &MotorCommand,
        homed: u8,
        config: &Config,
    ) -> FaultSet {
        let mut faults = FaultSet::NONE;
        if command.session != config.session {
            faults.insert(TripCause::SessionMismatch);
            return faults;
        }
        match &self.newest {
            Some(last) if last.incarnation != command.incarnation => {
                faults.insert(TripCause::ControlChanged);
                self.pacing = Pacing::default();
            }
            Some(last)
                if command.sequence <= last.sequence || command.sample_tick < last.sample_tick =>
            {
                faults.insert(TripCause::CommandBackwards);
                return faults;
            }
            _ => {}
        }
        let expected = signature(CONTROL_CYCLE, command.token_sequence);
        faults.insert_if(command.flow != expected, TripCause::ProgramFlow);
        let too_fast = self.pacing.too_fast(command.computed_ns, config.rates.control_period_ns());
        faults.insert_if(too_fast, TripCause::TooFast);
        faults.insert_if(volts_beyond(&command.volts, homed, config), TripCause::VoltageLimit);
        self.newest = Some(*command);
        faults
    }
}

/// Age of a message, counted from the older of two times; `None` if either lies in the future.
pub(super) fn age_ns(
    now_ns: u64,
    message: &impl Message,
    other_ns: u64,
    config: &Config,
) -> Option<u64> {
    let latest_ns = message.time_ns().max(other_ns);
    (latest_ns <= now_ns.saturating_add(config.future_ns))
        .then(|| now_ns.saturating_sub(message.time_ns().min(other_ns)))
}

/// Whether the card that took a sample has outputs.
pub(super) fn takes_volts(sample: &Sample) -> bool {
    capabilities(sample).is_some_and(|card| card.accepts_output)
}

/// Whether the card that took a sample drops the motor when the enable line stops toggling.
pub(super) fn has_enable_line(sample: &Sample) -> bool {
    capabilities(sample).is_some_and(|card| card.enable_line.is_some())
}

/// Whether the card that took a sample tells if the motor has power.
pub(super) fn reports_power(sample: &Sample, config: &Config) -> bool {
    let wired = config.comedi_reports_power || sample.backend != CardKind::Comedi.code();
    wired && capabilities(sample).is_some_and(|card| card.reports_power)
}

/// What the card that took a sample can do; `None` for a kind that this build does not know.
fn capabilities(sample: &Sample) -> Option<Capabilities> {
    CardKind::from_code(sample.backend).map(CardKind::capabilities)
}

/// Whether the card is real and a process lacks real-time scheduling.
pub(super) fn lacks_realtime(
    sample: &Sample,
    command: Option<&MotorCommand>,
    config: &Config,
) -> bool {
    let realtime = Profile::Realtime.code();
    capabilities(sample).is_some_and(|card| card.real)
        && (config.profile != Profile::Realtime
            || sample.profile != realtime
            || command.is_some_and(|command| command.profile != realtime))
}

/// Whether an axis gets more volts than it may, homed or not; on axes that the rig lacks, any.
fn volts_beyond(volts: &[f64; AXES], homed: u8, config: &Config) -> bool {
    let most = |at: usize| {
        let axis = config.axes.get(at);
        axis.map_or(0.0, |axis| LimitsNow::of(axis, homed & 1 << at != 0).volts)
    };
    volts.iter().enumerate().any(|(axis, &volts)| beyond(volts, most(axis)))
}

/// True also where the value or the limit is not a number.
fn beyond(value: f64, limit: f64) -> bool {
    !matches!(
        value.abs().partial_cmp(&limit),
        Some(std::cmp::Ordering::Less | std::cmp::Ordering::Equal)
    )
}

/// What is wrong with the measured values themselves.
fn measured(sample: &Sample, config: &Config) -> FaultSet {
    let mut faults = FaultSet::NONE;
    for (axis, entry) in config.axes.iter().enumerate() {
        let bit = 1 << axis;
        let now = LimitsNow::of(entry, sample.homed & bit != 0);
        faults.insert_if(sample.master_present & bit == 0, TripCause::SensorInvalid);
        faults.insert_if(
            entry.torque.is_some() && sample.torque_present & bit == 0,
            TripCause::SensorInvalid,
        );
        // An axis with one encoder has none declared; a record may lack it, and moves nothing.
        faults.insert_if(
            entry.slave.is_some() && sample.slave_present & bit == 0 && takes_volts(sample),
            TripCause::SensorInvalid,
        );
        for (value, present) in [
            (sample.master_position[axis], sample.master_present),
            (sample.slave_position[axis], sample.slave_present),
        ] {
            if present & bit != 0 {
                faults.insert_if(!value.is_finite(), TripCause::SensorInvalid);
                let inside = (now.position.0..=now.position.1).contains(&value);
                faults.insert_if(value.is_finite() && !inside, TripCause::PositionLimit);
            }
        }
        if sample.torque_present & bit != 0 {
            let torque = sample.slave_torque[axis];
            faults.insert_if(!torque.is_finite(), TripCause::SensorInvalid);
            faults.insert_if(
                torque.is_finite()
                    && entry.limits.torque_max.is_some_and(|most| beyond(torque, most)),
                TripCause::TorqueLimit,
            );
        }
        if sample.motor_present & bit != 0 {
            let volts = sample.motor_v[axis];
            faults.insert_if(!volts.is_finite(), TripCause::SensorInvalid);
            // A replayed record shows volts of another day: they reach no motor.
            let live = takes_volts(sample) && volts.is_finite();
            faults.insert_if(live && beyond(volts, now.volts), TripCause::VoltageLimit);
        }
    }
    faults.insert_if(volts_beyond(&sample.output_v, sample.homed, config), TripCause::VoltageLimit);
    for (channel, volts) in sample.analog_v.iter().enumerate() {
        let present = sample.analog_present & (1 << channel) != 0;
        faults.insert_if(present && !volts.is_finite(), TripCause::SensorInvalid);
    }
    faults
}

/// Whether an encoder moved further than the machine can in the ticks between two samples.
fn jumped(last: &Sample, sample: &Sample, config: &Config) -> bool {
    let ticks = sample.tick - last.tick;
    config.axes.iter().enumerate().any(|(axis, entry)| {
        let bit = 1 << axis;
        [
            (
                last.master_counts[axis],
                sample.master_counts[axis],
                last.master_present & sample.master_present,
            ),
            (
                last.slave_counts[axis],
                sample.slave_counts[axis],
                last.slave_present & sample.slave_present,
            ),
        ]
        .into_iter()
        .any(|(before, after, present)| {
            present & bit != 0 && entry.limits.is_jump(before, after, ticks)
        })
    })
}

//! The simulated card as a pure core: the caller passes tick and time.

use ipc_types::{ANALOG, AXES, CardScan, Performance};
use plant::coupled_axes::Plant;
use plant::sensors::{
    Drift, Emg, EmgParameters, ScannerEmulator, TorqueCell, TorqueCellParameters,
};
use plant::transmission::{Input, Motion};
use rand::{RngExt as _, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use rig::{Axis, ChannelKind, DIGITAL_HIGH_V, RigFile, ScannerInput};

use crate::faults::{Action, ActiveFaults, Counters, FaultNotice, Injection};
use crate::machine::{CardError, plant_of};
use crate::subject::Subject;

/// Range of an analog input that the rig file does not describe (V).
const DEFAULT_RANGE_V: f64 = 10.0;

/// Where the machine is when the card gets power, and where its counters begin.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PowerUp {
    /// Position of each handle (rad or m).
    pub handle: [f64; AXES],
    /// Count of each master at position 0.
    pub master_zero: [i64; AXES],
    /// Count of each slave at position 0.
    pub slave_zero: [i64; AXES],
}

/// Largest count at position 0 of an incremental encoder, in either direction.
const LARGEST_ZERO: i64 = 1_000_000;
/// Part of the range between the stops in which a handle is found at power-up.
const FOUND_WITHIN: f64 = 0.95;

impl PowerUp {
    /// Axes with incremental encoders are anywhere between their stops, with any count; the others
    /// at 0, with their own. The same seed gives the same.
    pub fn random(rig: &RigFile, seed: u64) -> Self {
        let mut generator = Pcg64Mcg::seed_from_u64(seed);
        let mut found = Self::default();
        for (at, axis) in rig.axes.iter().enumerate().take(AXES) {
            let Some(search) = axis.stop_search() else { continue };
            let (lower, upper) = rig.simulation.end_stops.unwrap_or((search.lower, search.upper));
            let share = generator.random_range(-FOUND_WITHIN..FOUND_WITHIN);
            found.handle[at] = 0.5 * (lower + upper) + 0.5 * share * (upper - lower);
            found.master_zero[at] = generator.random_range(-LARGEST_ZERO..=LARGEST_ZERO);
            found.slave_zero[at] = generator.random_range(-LARGEST_ZERO..=LARGEST_ZERO);
        }
        found
    }
}

/// The sensors of one axis.
#[derive(Debug)]
struct Sensors {
    axis: Axis,
    /// Index of the analog channel, and the cell.
    torque_cell: Option<(usize, TorqueCell)>,
}

/// The card.
#[derive(Debug)]
pub struct Card {
    plant: Plant,
    sensors: Vec<Sensors>,
    /// Analog channels of kind `emg`.
    emg_channels: Vec<usize>,
    /// Simulated muscles of the first axis; `None` without EMG channels.
    muscles: Option<Emg>,
    /// Analog channels of kind `other`: noise only.
    other_channels: Vec<usize>,
    /// The simulated scanner; `None` if the rig file declares none.
    scanner: Option<ScannerEmulator>,
    /// Analog channels that carry the scanner's trigger.
    trigger_channels: Vec<usize>,
    /// Digital input that carries it, if one does.
    trigger_bit: Option<u32>,
    first_tick: Option<u64>,
    analog_noise_v: f64,
    encoder_noise_counts: f64,
    subject: Subject,
    /// Scans since the motor got power. A moving hand starts with motor power, so that the rig can
    /// be armed at rest.
    powered_scans: u64,
    generator: Pcg64Mcg,
    period_s: f64,
    power_up: PowerUp,
    /// Motor power is cut this long after the last valid toggle of the enable line (ns).
    enable_line_timeout_ns: u64,
    dac_v: [f64; AXES],
    digital_out: u8,
    /// Incarnation of the watchdog that last drove the enable line, and its toggle count.
    enable_line: Option<(u64, u64)>,
    /// Time of the last edge (ns).
    edge_at_ns: Option<u64>,
    /// Time of the last edge that counts as a sign of life (ns).
    alive_at_ns: Option<u64>,
    output_sequence: u64,
    output_incarnation: u64,
    /// Highest tick that acquisition has read and published.
    taken_tick: u64,
    faults: ActiveFaults,
    counters: Counters,
    /// Analog inputs of the scan before (V).
    analog_before_v: [f64; ANALOG],
    /// Volts that acted on the motors after the newest scan (V).
    applied_v: [f64; AXES],
}

impl Card {
    /// A card at rest. `effects` (`ID[@SITE][=SIZE]`) are added to the plant of every axis, besides
    /// those of the rig file; no declared model includes them. The motors lose power
    /// `enable_line_timeout_ns` after the last toggle of the enable line.
    pub fn new(
        rig: &RigFile,
        effects: &[String],
        enable_line_timeout_ns: u64,
    ) -> Result<Self, CardError> {
        let plant = plant_of(rig, effects)?;
        let simulation = &rig.simulation;
        let hand = simulation.hand;
        let channels = |wanted: fn(ChannelKind) -> bool| -> Vec<usize> {
            rig.channels
                .iter()
                .filter(|channel| wanted(channel.kind))
                .map(|channel| channel.index)
                .collect()
        };
        let sensors =
            rig.axes.iter().zip(0..).map(|(axis, at)| Sensors::new(rig, axis, at)).collect();
        let period_s = 1.0 / f64::from(rig.rates.acquisition_hz);
        let emg_channels = channels(|kind| kind == ChannelKind::Emg);
        let standard = EmgParameters::default();
        let muscles = EmgParameters {
            full_rms_v: simulation.emg_rms_v,
            // Electrode noise scaled with the signal.
            floor_rms_v: simulation.emg_rms_v * standard.floor_rms_v / standard.full_rms_v,
            cocontraction: simulation.emg_cocontraction,
            ..standard
        };
        let muscles = (!emg_channels.is_empty())
            .then(|| Emg::new(muscles, period_s, simulation.seed))
            .transpose()?;
        Ok(Self {
            plant,
            sensors,
            emg_channels,
            muscles,
            other_channels: channels(|kind| kind == ChannelKind::Other),
            scanner: simulation.scanner.clone().map(ScannerEmulator::checked).transpose()?,
            trigger_channels: channels(|kind| kind == ChannelKind::Trigger),
            trigger_bit: rig.scanner.and_then(|line| match line.input {
                ScannerInput::Digital(bit) => Some(bit),
                ScannerInput::Analog(_) => None,
            }),
            first_tick: None,
            analog_noise_v: simulation.analog_noise_v,
            encoder_noise_counts: simulation.encoder_noise_counts,
            subject: Subject::new(hand, simulation.seed),
            powered_scans: 0,
            generator: Pcg64Mcg::seed_from_u64(simulation.seed ^ 0x5ca1_ab1e),
            period_s,
            power_up: PowerUp::default(),
            enable_line_timeout_ns,
            dac_v: [0.0; AXES],
            digital_out: 0,
            enable_line: None,
            edge_at_ns: None,
            alive_at_ns: None,
            output_sequence: 0,
            output_incarnation: 0,
            taken_tick: 0,
            faults: ActiveFaults::new(),
            counters: Counters::default(),
            analog_before_v: [0.0; ANALOG],
            applied_v: [0.0; AXES],
        })
    }

    /// The same card, powered up elsewhere. Call before the first scan.
    #[must_use]
    pub fn with_power_up(mut self, power_up: PowerUp) -> Self {
        for (axis, position) in power_up.handle.into_iter().enumerate() {
            if position != 0.0 {
                self.plant.rest_at(axis, position);
            }
        }
        self.power_up = power_up;
        self
    }

    /// Changes the machine while it moves, and returns the one before; positions, velocities and
    /// time stay. Allocates nothing.
    pub fn replace_plant(&mut self, mut plant: Plant) -> Plant {
        plant.go_on_from(&self.plant);
        std::mem::replace(&mut self.plant, plant)
    }

    /// Begins a fault with the next scan; one of the same kind and place ends then. A fault of the
    /// machine comes with the machine that has it. Returns a machine that is no longer needed: the
    /// one before, or that of a fault that was refused because too many are in force. Allocates
    /// nothing.
    pub fn begin_fault(
        &mut self,
        injection: &Injection,
        plant: Option<Plant>,
    ) -> (bool, Option<Plant>) {
        if !self.faults.begin(*injection) {
            return (false, plant);
        }
        let (axis, encoder) = (injection.axis, injection.at.encoder());
        if injection.action == Action::EncoderJump && axis < AXES {
            self.counters[axis][encoder].jump(injection.size as i64);
        }
        (true, plant.map(|plant| self.replace_plant(plant)))
    }

    /// Ends the fault of that number with the next scan.
    pub fn end_fault(&mut self, number: u64) {
        self.faults.end(number);
    }

    /// A fault that has begun or ended with a scan, oldest first; ask after each scan.
    pub fn fault_notice(&mut self) -> Option<FaultNotice> {
        self.faults.notice()
    }

    /// Whether the newest scan is lost: the FIFO overflows.
    pub fn scan_is_lost(&self) -> bool {
        self.faults.any(Action::FifoOverflow)
    }

    /// Volts that acted on the motors after the newest scan, whatever the read-back shows (V).
    pub const fn applied_v(&self) -> [f64; AXES] {
        self.applied_v
    }

    /// Writes the DACs; they hold until the next write. A value that is not finite is written as 0
    /// V.
    pub fn write(&mut self, volts: [f64; AXES], sequence: u64, incarnation: u64) {
        for (axis, (held, volts)) in self.dac_v.iter_mut().zip(volts).enumerate() {
            if !self.faults.dac_stuck(axis) {
                *held = if volts.is_finite() { volts } else { 0.0 };
            }
        }
        self.output_sequence = sequence;
        self.output_incarnation = incarnation;
    }

    /// Sets the eight digital outputs, one bit each; they hold until the next call.
    pub const fn set_digital(&mut self, levels: u32) {
        self.digital_out = levels as u8;
    }

    /// Shows the subject at the handle the light and the bars.
    pub fn show(&mut self, shown: &Performance) {
        self.subject.see(shown);
    }

    /// Records that all scans up to `tick` were read from the FIFO and published.
    pub fn taken(&mut self, tick: u64) {
        self.taken_tick = self.taken_tick.max(tick);
    }

    /// Updates the enable line: at `time_ns` the watchdog `incarnation` reports that it has toggled
    /// the line `toggles` times. An unchanged count is no edge. A single edge does not restore
    /// power, since a restarting watchdog makes one when it initialises the line: motor power needs
    /// two edges within the line's timeout. The first report of a new incarnation only sets the
    /// reference count, so that two watchdogs with different levels make no edges between them.
    pub fn enable_line(&mut self, incarnation: u64, toggles: u64, time_ns: u64) {
        if self.faults.any(Action::LineBroken) {
            return;
        }
        let previous = self.enable_line.replace((incarnation, toggles));
        if previous.is_some_and(|(sender, _)| sender != incarnation) {
            self.edge_at_ns = None;
        } else if previous.is_some_and(|(_, count)| count != toggles) {
            let edge_ns = self.edge_at_ns.map_or(time_ns, |before| before.max(time_ns));
            if self
                .edge_at_ns
                .replace(edge_ns)
                .is_some_and(|before| edge_ns - before <= self.enable_line_timeout_ns)
            {
                self.alive_at_ns = Some(edge_ns);
            }
        }
    }

    /// A normal random number with this standard deviation.
    fn noise(&mut self, deviation: f64) -> f64 {
        let sample: f64 = StandardNormal.sample(&mut self.generator);
        deviation * sample
    }

    /// Whether the motor has power at `time_ns`.
    fn powered(&self, time_ns: u64) -> bool {
        self.alive_at_ns
            .is_some_and(|toggled| time_ns.saturating_sub(toggled) <= self.enable_line_timeout_ns)
    }

    /// Runs one period: takes a scan at `time_ns`, then steps the plant to the next scan with the
    /// voltages that are now applied to the motors.
    pub fn clock(&mut self, tick: u64, time_ns: u64) -> CardScan {
        let plant = &mut self.plant;
        self.faults.advance(tick, |number| plant.end_breakdown(number));
        let alive = self.powered(time_ns);
        let powered = self.faults.relay(alive);
        let motor_v = if powered { self.dac_v } else { [0.0; AXES] };
        let mut scan = CardScan {
            tick,
            scan_time_ns: time_ns,
            taken_tick: self.taken_tick,
            dac_v: self.dac_v,
            digital_out: self.digital_out,
            motor_v,
            output_sequence: self.output_sequence,
            output_incarnation: self.output_incarnation,
            line_age_ns: self
                .alive_at_ns
                .map_or(u64::MAX, |toggled| time_ns.saturating_sub(toggled)),
            motor_power: u8::from(powered),
            axes: self.sensors.len() as u8,
            ..CardScan::default()
        };
        for index in 0..self.sensors.len().min(AXES) {
            self.read_axis(index, &mut scan);
        }
        let reading = self.plant.reading(0);
        // Channels alternate between flexor and extensor; activation follows the hand's torque.
        if let Some(muscles) = &mut self.muscles {
            let volts = muscles.read(reading.slave_torque_nm);
            for (&channel, volts) in self.emg_channels.iter().zip(volts) {
                self.set_analog(&mut scan, channel, volts);
            }
        }
        for index in 0..self.other_channels.len() {
            let volts = self.noise(self.analog_noise_v);
            self.set_analog(&mut scan, self.other_channels[index], volts);
        }
        if let Some(scanner) = &self.scanner {
            // The first volume begins with the card's first scan.
            let ticks_since_start = tick.saturating_sub(*self.first_tick.get_or_insert(tick));
            let level = match self.faults.any(Action::TriggerLost) {
                true => scanner.trigger.idle_v,
                false => scanner.volts(ticks_since_start as f64 * self.period_s),
            };
            if let Some(bit) = self.trigger_bit.filter(|_| level > DIGITAL_HIGH_V) {
                scan.digital_in |= 1 << bit;
            }
            for index in 0..self.trigger_channels.len() {
                let volts = level + self.noise(self.analog_noise_v);
                self.set_analog(&mut scan, self.trigger_channels[index], volts);
            }
        }
        self.faults.analog(&mut scan.analog_v, &self.analog_before_v);
        self.analog_before_v = scan.analog_v;
        self.powered_scans = if powered { self.powered_scans + 1 } else { 0 };
        let time_s = self.powered_scans as f64 * self.period_s;
        let motion: [(f64, f64); AXES] = std::array::from_fn(|axis| {
            let motion = self.plant.motion(axis);
            (motion.slave_position_rad, motion.slave_velocity_rad_s)
        });
        let torques = self.subject.torques(&motion, time_s, time_ns);
        self.applied_v =
            std::array::from_fn(|axis| self.faults.drive(axis, motor_v[axis], powered));
        let inputs: [Input; AXES] = std::array::from_fn(|axis| Input {
            motor_v: self.applied_v[axis],
            hand_torque_nm: torques[axis],
        });
        self.plant.step(&inputs, self.period_s);
        scan
    }

    /// Writes the encoder counts and torque-cell voltage of one axis into the scan.
    fn read_axis(&mut self, index: usize, scan: &mut CardScan) {
        let reading = self.plant.reading(index);
        let (master, slave) = (self.sensors[index].axis.master, self.sensors[index].axis.slave);
        // Encoder noise is a fraction of a count and is added before rounding, so it shows only
        // near a count transition.
        let rad_per_count = 1.0 / master.counts_per_unit;
        let noise_rad = self.noise(self.encoder_noise_counts * rad_per_count);
        let master_handle_rad = reading.master_rad / master.turns_per_handle_turn;
        let raw = master.counts(master_handle_rad + noise_rad).round() as i64
            + self.power_up.master_zero[index];
        let counter = &mut self.counters[index][0];
        scan.master_counts[index] = self.faults.encoder(counter, (index, 0), raw);
        if let Some(slave) = slave {
            let noise_rad = self.noise(self.encoder_noise_counts / slave.counts_per_unit);
            let raw = slave.counts(reading.slave_rad + noise_rad).round() as i64
                + self.power_up.slave_zero[index];
            let counter = &mut self.counters[index][1];
            scan.slave_counts[index] = self.faults.encoder(counter, (index, 1), raw);
        }
        if let Some((channel, cell)) = &mut self.sensors[index].torque_cell
            && let Some(volts) = scan.analog_v.get_mut(*channel)
        {
            *volts = cell.read(reading.slave_torque_nm, self.period_s);
        }
    }

    fn set_analog(&self, scan: &mut CardScan, channel: usize, volts: f64) {
        debug_assert!(channel < ANALOG);
        if let Some(value) = scan.analog_v.get_mut(channel) {
            *value = volts;
        }
    }

    /// True motion of axis 0, without sensor errors; for tests.
    pub fn motion(&self) -> Motion {
        self.motion_of(0)
    }

    /// True motion of one axis, without sensor errors; all zero if the rig has no such axis.
    pub fn motion_of(&self, axis: usize) -> Motion {
        self.plant.motion(axis)
    }
}

impl Sensors {
    /// `axis_index` gives the axis's torque cell a noise seed of its own.
    fn new(rig: &RigFile, axis: &Axis, axis_index: u64) -> Self {
        let simulation = &rig.simulation;
        let torque_cell = axis.torque.as_ref().map(|torque| {
            let input_channel = rig.channel_at(torque.channel);
            let cell = TorqueCellParameters {
                volts_per_nm: torque.volts_per_unit,
                offset_v: torque.offset_v,
                noise_v: simulation.torque_noise_v,
                bandwidth_hz: simulation.torque_bandwidth_hz,
                limit_v: input_channel.map_or(DEFAULT_RANGE_V, |channel| channel.range_v),
            };
            let drift = Drift {
                ramp_v_per_s: simulation.torque_drift_v_per_s,
                walk_v_per_sqrt_s: simulation.torque_walk_v_per_sqrt_s,
            };
            let seed = simulation.seed.wrapping_add(axis_index << 32);
            (torque.channel, TorqueCell::new(cell, seed).with_drift(drift))
        });
        Self { axis: axis.clone(), torque_cell }
    }
}

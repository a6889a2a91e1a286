//! The card without a clock.

use ipc_types::{ANALOG, AXES, CardScan};
use plant::ParameterError;
use plant::axes::{CouplingError, HandleCoupling, Plant};
use plant::effects::end_stop::EndStop;
use plant::effects::{EffectError, parse};
use plant::sensors::{Drift, Emg, EmgParameters, ScannerTrigger, TorqueCell, TorqueCellParameters};
use plant::transmission::{Input, Motion};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use rig::{Axis, ChannelKind, Hand, HandKind, RigFile};
use thiserror::Error;

/// The simulated card cannot be made from this rig file.
#[derive(Debug, Error)]
#[allow(missing_docs)]
pub enum CardError {
    #[error(transparent)]
    Rig(#[from] rig::RigError),
    #[error("plant: {0}")]
    Parameter(#[from] ParameterError),
    #[error("--effect: {0}")]
    Effect(#[from] EffectError),
    #[error("handle: {0}")]
    Coupling(#[from] CouplingError),
    /// No plant for that.
    #[error(
        "{file}: the simulated card has a plant for the model kinds \"hydrostatic\" and \
         \"cable\"; found kind \"{kind}\". Put a measured record there instead (`farreach up \
         --replay RECORD`)"
    )]
    NoPlant { file: String, kind: &'static str },
}

/// The sensors of one axis.
#[derive(Debug)]
struct Sensors {
    axis: Axis,
    torque_cell: Option<(usize, TorqueCell)>,
}

/// The card.
#[derive(Debug)]
pub struct Card {
    plant: Plant,
    sensors: Vec<Sensors>,
    /// The EMG's channels, and the muscles under the electrodes, which move the first axis; none
    /// where there are no channels.
    emg: Vec<usize>,
    muscles: Option<Emg>,
    other: Vec<usize>,
    /// The scanner and the channels that its line goes to; none where no scanner runs.
    scanner: Option<ScannerTrigger>,
    triggers: Vec<usize>,
    first_tick: Option<u64>,
    analog_noise_v: f64,
    encoder_noise_counts: f64,
    hand: Hand,
    /// Scans since the motor has had power: a moving hand sets off with it, so that the rig can be
    /// armed at rest.
    powered_scans: u64,
    generator: Pcg64Mcg,
    period_s: f64,
    line_ns: u64,
    dac_v: [f64; AXES],
    /// Which watchdog set the line last, and how often it had changed the level.
    line: Option<(u64, u64)>,
    /// The last edge, and the last one that kept the line alive.
    edge_ns: Option<u64>,
    toggled_ns: Option<u64>,
    output_sequence: u64,
    output_incarnation: u64,
    taken_tick: u64,
}

impl Card {
    /// A card at rest. `effects` are `ID[@SITE][=SIZE]` and go into the plant only, into each axis,
    /// beside those that the rig file declares: no model is told of them. `line_ns` is how long
    /// after the enable line's last toggle the motors keep their power.
    pub fn new(rig: &RigFile, effects: &[String], line_ns: u64) -> Result<Self, CardError> {
        let kind = rig.model.kind;
        if !kind.is_transmission() {
            return Err(CardError::NoPlant { file: rig.file_name().to_owned(), kind: kind.name() });
        }
        let simulation = &rig.simulation;
        let hand = simulation.hand;
        let mut transmissions = Vec::with_capacity(rig.axes.len());
        for axis in &rig.axes {
            let mut parameters = rig.axis_parameters(axis)?;
            if hand.kind != HandKind::Absent {
                parameters.load_handle(hand.inertia)?;
            }
            let asked = effects.iter().map(|text| parse(text)).collect::<Result<Vec<_>, _>>()?;
            let mut effects = rig.model_effects()?;
            effects.extend(asked);
            if let Some((lower, upper)) = simulation.end_stops {
                effects.push(Box::new(EndStop::between(lower, upper)));
            }
            transmissions.push(parameters.plant(effects)?);
        }
        let coupling = HandleCoupling::of_pairs(rig.axes.len(), &rig.model.handle_coupling)?;
        let plant = Plant::new(transmissions, &coupling)?;
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
        let emg = channels(|kind| kind == ChannelKind::Emg);
        let standard = EmgParameters::default();
        let muscles = EmgParameters {
            full_rms_v: simulation.emg_rms_v,
            // The electrodes' noise, in proportion.
            floor_rms_v: simulation.emg_rms_v * standard.floor_rms_v / standard.full_rms_v,
            ..standard
        };
        let muscles =
            (!emg.is_empty()).then(|| Emg::new(muscles, period_s, simulation.seed)).transpose()?;
        Ok(Self {
            plant,
            sensors,
            emg,
            muscles,
            other: channels(|kind| kind == ChannelKind::Other),
            scanner: simulation.scanner.map(ScannerTrigger::checked).transpose()?,
            triggers: channels(|kind| kind == ChannelKind::Trigger),
            first_tick: None,
            analog_noise_v: simulation.analog_noise_v,
            encoder_noise_counts: simulation.encoder_noise_counts,
            hand,
            powered_scans: 0,
            generator: Pcg64Mcg::seed_from_u64(simulation.seed ^ 0x5ca1_ab1e),
            period_s,
            line_ns,
            dac_v: [0.0; AXES],
            line: None,
            edge_ns: None,
            toggled_ns: None,
            output_sequence: 0,
            output_incarnation: 0,
            taken_tick: 0,
        })
    }

    /// Writes the DACs; they hold until the next write. A value that is not finite is written as 0
    /// V.
    pub fn write(&mut self, volts: [f64; AXES], sequence: u64, incarnation: u64) {
        self.dac_v = volts.map(|v| if v.is_finite() { v } else { 0.0 });
        self.output_sequence = sequence;
        self.output_incarnation = incarnation;
    }

    /// Takes note that scans up to `tick` were taken out of the FIFO and published.
    pub fn taken(&mut self, tick: u64) {
        self.taken_tick = self.taken_tick.max(tick);
    }

    /// Highest tick that was taken.
    pub fn taken_tick(&self) -> u64 {
        self.taken_tick
    }

    /// A watchdog (`incarnation`) says at `time_ns` that it has changed the enable line's level
    /// `toggles` times. The same count again is no edge. One edge is no sign of life, for a
    /// watchdog that starts again makes one when it sets the line to a known level: power comes
    /// with the second of two edges that are no further apart than the card is patient. Two
    /// watchdogs that hold different levels make no edges between them: what another one says is a
    /// level to begin with.
    pub fn enable_line(&mut self, incarnation: u64, toggles: u64, time_ns: u64) {
        let before = self.line.replace((incarnation, toggles));
        if before.is_some_and(|(sender, _)| sender != incarnation) {
            self.edge_ns = None;
        } else if before.is_some_and(|(_, count)| count != toggles) {
            let edge_ns = self.edge_ns.map_or(time_ns, |before| before.max(time_ns));
            if self.edge_ns.replace(edge_ns).is_some_and(|before| edge_ns - before <= self.line_ns)
            {
                self.toggled_ns = Some(edge_ns);
            }
        }
    }

    fn noise(&mut self, deviation: f64) -> f64 {
        let sample: f64 = StandardNormal.sample(&mut self.generator);
        deviation * sample
    }

    /// Whether the motor has power at `time_ns`.
    fn powered(&self, time_ns: u64) -> bool {
        self.toggled_ns.is_some_and(|toggled| time_ns.saturating_sub(toggled) <= self.line_ns)
    }

    /// One period of the card: takes a scan at `time_ns`, then lets the plant run to the next one
    /// on the volts that reach the motors now.
    pub fn clock(&mut self, tick: u64, time_ns: u64) -> CardScan {
        let powered = self.powered(time_ns);
        let motor_v = if powered { self.dac_v } else { [0.0; AXES] };
        let mut scan = CardScan {
            tick,
            scan_time_ns: time_ns,
            taken_tick: self.taken_tick,
            dac_v: self.dac_v,
            motor_v,
            output_sequence: self.output_sequence,
            output_incarnation: self.output_incarnation,
            line_age_ns: self
                .toggled_ns
                .map_or(u64::MAX, |toggled| time_ns.saturating_sub(toggled)),
            motor_power: u8::from(powered),
            axes: self.sensors.len() as u8,
            ..CardScan::default()
        };
        for index in 0..self.sensors.len().min(AXES) {
            self.read_axis(index, &mut scan);
        }
        let reading = self.plant.reading(0);
        // Flexors and extensors in turn, as active as the hand's torque asks.
        if let Some(muscles) = &mut self.muscles {
            let volts = muscles.read(reading.slave_torque_nm);
            for (&channel, volts) in self.emg.iter().zip(volts) {
                self.set_analog(&mut scan, channel, volts);
            }
        }
        for index in 0..self.other.len() {
            let volts = self.noise(self.analog_noise_v);
            self.set_analog(&mut scan, self.other[index], volts);
        }
        if let Some(scanner) = &self.scanner {
            // The first volume begins with the card's first scan.
            let ticks = tick.saturating_sub(*self.first_tick.get_or_insert(tick));
            let level = scanner.volts(ticks as f64 * self.period_s);
            for index in 0..self.triggers.len() {
                let volts = level + self.noise(self.analog_noise_v);
                self.set_analog(&mut scan, self.triggers[index], volts);
            }
        }
        self.powered_scans = if powered { self.powered_scans + 1 } else { 0 };
        let time_s = self.powered_scans as f64 * self.period_s;
        let inputs: [Input; AXES] = std::array::from_fn(|axis| {
            let motion = self.plant.motion(axis);
            let hand_torque_nm =
                self.hand.torque(motion.slave_position_rad, motion.slave_velocity_rad_s, time_s);
            Input { motor_v: motor_v[axis], hand_torque_nm }
        });
        self.plant.step(&inputs, self.period_s);
        scan
    }

    /// Encoders and torque cell of one axis into the scan.
    fn read_axis(&mut self, index: usize, scan: &mut CardScan) {
        let reading = self.plant.reading(index);
        let (master, slave) = (self.sensors[index].axis.master, self.sensors[index].axis.slave);
        // Noise of the encoder is a fraction of a count, before rounding: it decides only near an
        // edge.
        let count = 1.0 / master.counts_per_unit;
        let jitter = self.noise(self.encoder_noise_counts * count);
        let master_rad = reading.master_rad / master.turns_per_handle_turn;
        scan.master_counts[index] = master.counts(master_rad + jitter).round() as i64;
        if let Some(slave) = slave {
            let jitter = self.noise(self.encoder_noise_counts / slave.counts_per_unit);
            scan.slave_counts[index] = slave.counts(reading.slave_rad + jitter).round() as i64;
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

    /// Where the first axis of the plant truly is, for tests.
    pub fn motion(&self) -> Motion {
        self.plant.motion(0)
    }

    /// Where an axis of the plant truly is; all zero where the rig has no such axis.
    pub fn motion_of(&self, axis: usize) -> Motion {
        self.plant.motion(axis)
    }
}

impl Sensors {
    /// The torque cell of each axis has noise of its own.
    fn new(rig: &RigFile, axis: &Axis, at: u64) -> Self {
        let simulation = &rig.simulation;
        let torque_cell = axis.torque.as_ref().map(|torque| {
            let range = rig.channels.iter().find(|channel| channel.index == torque.channel);
            let cell = TorqueCellParameters {
                volts_per_nm: torque.volts_per_unit,
                offset_v: torque.offset_v,
                noise_v: simulation.torque_noise_v,
                bandwidth_hz: simulation.torque_bandwidth_hz,
                limit_v: range.map_or(10.0, |channel| channel.range_v),
            };
            let drift = Drift {
                ramp_v_per_s: simulation.torque_drift_v_per_s,
                walk_v_per_sqrt_s: simulation.torque_walk_v_per_sqrt_s,
            };
            let seed = simulation.seed.wrapping_add(at << 32);
            (torque.channel, TorqueCell::new(cell, seed).with_drift(drift))
        });
        Self { axis: axis.clone(), torque_cell }
    }
}

//! The wiring of the rig file, found on the card.

use std::path::Path;

use comedi::{
    ComediError, Device, InstructionList, Kind, Place, Range, Stream, StreamSettings, Subdevice,
    channel_spec, narrowest,
};
use ipc_types::CardKind;
use rig::{Calibration, ComediCard, EncoderCounter, RigFile};

use super::boards::{Board, Boards, Counter};
use super::digital::Digital;
use super::power_up::Started;

/// Scans that the kernel buffers at least.
pub(super) const FIFO: usize = CardKind::Comedi.capabilities().fifo_depth;

/// An analog input, in the order of the stream.
#[derive(Debug)]
pub(super) struct Input {
    pub(super) index: usize,
    range: Range,
    line: Calibration,
}

impl Input {
    /// Volts at the terminal (V).
    pub(super) fn volts(&self, code: u32) -> f64 {
        self.line.terminal_v(self.range.volts(code))
    }
}

/// The output of a motor's voltage.
#[derive(Debug)]
pub(super) struct Output {
    pub(super) place: Place,
    subdevice: u32,
    chanspec: u32,
    range: Range,
    line: Calibration,
}

impl Output {
    /// The code for volts at the terminal, and the volts that it gives (V).
    pub(super) fn code(&self, volts: f64) -> (u32, f64) {
        let code = self.range.code(self.line.converter_v(volts));
        (code, self.line.terminal_v(self.range.volts(code)))
    }
}

/// All parts of the wiring; the first board is the card.
#[derive(Debug)]
pub(super) struct Wiring {
    pub(super) boards: Vec<Board>,
    pub(super) stream: Stream,
    pub(super) inputs: Vec<Input>,
    pub(super) outputs: Vec<Output>,
    pub(super) writes: InstructionList,
    /// Volts from code to code of the coarsest output (V).
    pub(super) resolution_v: f64,
    pub(super) masters: Vec<Counter>,
    pub(super) slaves: Vec<Option<Counter>>,
    pub(super) digital: Digital,
    output_subdevice: Option<u32>,
    /// Subdevices whose ranges are nominal, with no correction in the rig file.
    uncalibrated: bool,
    counters: Vec<EncoderCounter>,
}

impl Wiring {
    /// Opens the devices and checks that they have what the rig file says. Changes nothing.
    pub(super) fn check(rig: &RigFile, card: &ComediCard) -> Result<Self, ComediError> {
        let device = Device::open(&card.device)?;
        if let Some(driver) = &card.driver
            && *driver != device.driver()
        {
            return Err(ComediError::Differs {
                key: "comedi.driver".to_owned(),
                expected: format!("the driver {driver}"),
                found: device.driver().to_owned(),
                device: device.path().to_owned(),
                advice: "name the device that has it, or this driver",
            });
        }
        let mut boards = Boards::new(device);
        let inputs = inputs(rig, card, &boards.0[0].device)?;
        let outputs = outputs(card, &boards.0[0].device)?;
        let digital = Digital::check(rig, card, &mut boards)?;
        let (mut masters, mut slaves) = (Vec::new(), Vec::new());
        for (at, axis) in card.axes.iter().enumerate() {
            let key = |name: &str| format!("comedi.axes.{at}.{name}");
            masters.push(boards.counter(card, &key("master"), &axis.master)?);
            let slave = axis.slave.as_ref();
            let slave = slave.map(|own| boards.counter(card, &key("slave"), own)).transpose()?;
            slaves.push(slave);
        }
        let uncalibrated =
            inputs.subdevice.is_calibrated_by_software() && card.calibration.is_empty()
                || outputs.subdevice.is_some_and(|own| own.is_calibrated_by_software())
                    && card.axes.iter().filter_map(|axis| axis.output).all(|output| {
                        output.calibration == Calibration { gain: 1.0, offset_v: 0.0 }
                    });
        let own = |axis: &rig::ComediAxis| [Some(axis.master.clone()), axis.slave.clone()];
        Ok(Self {
            boards: boards.0,
            stream: inputs.stream,
            inputs: inputs.inputs,
            resolution_v: outputs.resolution_v,
            outputs: outputs.outputs,
            writes: outputs.writes,
            output_subdevice: outputs.subdevice.map(|own| own.number),
            masters,
            slaves,
            digital,
            uncalibrated,
            counters: card.axes.iter().flat_map(own).flatten().collect(),
        })
    }

    /// The card.
    pub(super) fn card(&self) -> &Device {
        &self.boards[0].device
    }

    /// Takes the card for this process, sets up lines and counters, and starts the stream. Returns
    /// the number of the power-up since which the counters count; `directory` keeps it.
    pub(super) fn start(&mut self, directory: Option<&Path>) -> Result<u64, ComediError> {
        let card = self.card();
        self.stream.reserve(card)?;
        if let Some(subdevice) = self.output_subdevice {
            card.lock(subdevice).map_err(card.refused("locking its outputs"))?;
        }
        self.digital.set_directions(&self.boards)?;
        if self.uncalibrated {
            eprintln!(
                "farreach acquisition: {}: volts are nominal, since nothing in the rig file \
                 corrects them and this driver's cards need it: see docs/comedi.md",
                card.path()
            );
        }
        let power_up = self.start_counters(directory)?;
        let card = &self.boards[0].device;
        self.stream.start(card).map_err(card.refused("starting its stream"))?;
        Ok(power_up)
    }

    /// Leaves the counters of an earlier process counting, or starts them. Returns the number of
    /// the power-up.
    fn start_counters(&self, directory: Option<&Path>) -> Result<u64, ComediError> {
        let nodes = self.boards.iter().map(|board| board.device.path());
        let started = Started::now(nodes, &self.counters);
        let counters = || self.masters.iter().chain(self.slaves.iter().flatten());
        let device = |counter: &Counter| &self.boards[counter.board].device;
        let still = |own: &Counter| own.mode.still_counts(device(own), &own.subdevice, own.channel);
        if let Some(number) = started.kept(directory).filter(|_| counters().all(still)) {
            return Ok(number);
        }
        for own in counters() {
            let device = device(own);
            own.mode
                .start(device, &own.subdevice, own.channel, own.terminals)
                .map_err(device.refused("starting a counter"))?;
        }
        Ok(started.keep(directory))
    }

    /// What the driver put out last (V).
    pub(super) fn held_v<const N: usize>(&self) -> Result<[f64; N], comedi::Errno> {
        let mut held = [0.0; N];
        for (to, output) in held.iter_mut().zip(&self.outputs) {
            let code = self.card().read(output.subdevice, output.chanspec)?;
            *to = output.line.terminal_v(output.range.volts(code));
        }
        Ok(held)
    }

    /// Reads counters and digital lines.
    pub(super) fn read(&mut self) -> Result<(), comedi::Errno> {
        self.boards.iter_mut().try_for_each(|board| board.readings.run(&board.device))
    }

    /// Follows the counters to what [`Wiring::read`] found: those of the masters, and of the
    /// slaves.
    pub(super) fn counts<const N: usize>(&mut self) -> [[i64; N]; 2] {
        let (mut master, mut slave) = ([0; N], [0; N]);
        let masters = master.iter_mut().zip(self.masters.iter_mut().map(Some));
        let slaves = slave.iter_mut().zip(self.slaves.iter_mut().map(Option::as_mut));
        for (to, counter) in masters.chain(slaves) {
            if let Some(counter) = counter {
                *to = counter.observe(&self.boards);
            }
        }
        [master, slave]
    }
}

/// The analog inputs of a card.
struct Inputs {
    subdevice: Subdevice,
    stream: Stream,
    inputs: Vec<Input>,
}

fn inputs(rig: &RigFile, card: &ComediCard, device: &Device) -> Result<Inputs, ComediError> {
    let first = |wanted: &dyn Fn(&Subdevice) -> bool| {
        device.subdevices().iter().find(|own| wanted(own)).map_or(0, |own| own.number)
    };
    let number = card
        .input
        .unwrap_or_else(|| first(&|own| own.kind == Kind::AnalogInput && own.streams_input()));
    let kinds = [Kind::AnalogInput];
    let subdevice = device.expect("comedi.input", number, 0, &kinds)?;
    let (mut inputs, mut channels) = (Vec::new(), Vec::new());
    for (at, channel) in rig.channels.iter().enumerate() {
        let key = format!("channels.{at}");
        device.expect(&key, number, channel.index as u32, &kinds)?;
        let key = format!("{key}.range_v");
        let (index, range) =
            range_of(device, &subdevice, channel.index as u32, channel.range_v, &key)?;
        let corrected = card.calibration.iter().find(|own| own.index == channel.index);
        let line = corrected.map_or(Calibration { gain: 1.0, offset_v: 0.0 }, |own| own.line);
        inputs.push(Input { index: channel.index, range, line });
        channels.push(channel_spec(channel.index as u32, index, card.reference));
    }
    let settings = StreamSettings {
        channels,
        period_ns: rig.rates.acquisition_period_ns() as u32,
        convert_ns: card.convert_ns,
        buffered_scans: FIFO,
    };
    let stream = Stream::check(device, &subdevice, &settings)?;
    Ok(Inputs { subdevice, stream, inputs })
}

/// The analog outputs of a card.
#[derive(Default)]
struct Outputs {
    subdevice: Option<Subdevice>,
    outputs: Vec<Output>,
    writes: InstructionList,
    resolution_v: f64,
}

fn outputs(card: &ComediCard, device: &Device) -> Result<Outputs, ComediError> {
    let mut all = Outputs::default();
    let is_output = |own: &&Subdevice| own.kind == Kind::AnalogOutput;
    let first = device.subdevices().iter().find(is_output).map(|own| own.number);
    let number = card.output.or(first).unwrap_or(0);
    for (at, axis) in card.axes.iter().enumerate() {
        let Some(output) = axis.output else { continue };
        let key = format!("comedi.axes.{at}.output");
        let channel = output.channel;
        let subdevice = device.expect(&key, number, channel, &[Kind::AnalogOutput])?;
        let key = format!("comedi.axes.{at}.output_range_v");
        let (index, range) = range_of(device, &subdevice, channel, output.range_v, &key)?;
        let line = output.calibration;
        let zero = range.code(line.converter_v(0.0));
        let chanspec = channel_spec(channel, index, 0);
        let place = all.writes.write(number, chanspec, zero);
        all.resolution_v = all.resolution_v.max(range.resolution_v() * line.gain.abs());
        all.outputs.push(Output { place, subdevice: number, chanspec, range, line });
        all.subdevice = Some(subdevice);
    }
    Ok(all)
}

/// The narrowest range of a channel that holds ± these volts.
fn range_of(
    device: &Device,
    subdevice: &Subdevice,
    channel: u32,
    volts: f64,
    key: &str,
) -> Result<(u32, Range), ComediError> {
    let ranges = device
        .ranges(subdevice, channel)
        .map_err(device.refused("asking for the ranges of a channel"))?;
    narrowest(&ranges, volts).ok_or_else(|| {
        let has: Vec<String> = ranges
            .iter()
            .flatten()
            .map(|range| format!("{} V to {} V", range.least_v, range.most_v))
            .collect();
        ComediError::Differs {
            device: device.path().to_owned(),
            key: key.to_owned(),
            expected: format!("a range that holds ±{volts} V"),
            found: format!("only {}", has.join(", ")),
            advice: "take a smaller range_v, with an amplifier or divider that fits",
        }
    })
}

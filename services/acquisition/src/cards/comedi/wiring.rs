//! The wiring of the rig file, found on the card.

use std::path::Path;

use comedi::{
    ComediError, CounterMode, Device, INPUTS, InstructionList, Kind, OUTPUTS, Place, Range, Stream,
    StreamSettings, Subdevice, UnwrappedCount, channel_spec, expect_input, lines, narrowest,
};
use ipc_types::CardKind;
use rig::{Calibration, ComediCard, DigitalLines, EncoderCounter, RigFile};

use super::power_up::Started;

/// Scans that the kernel buffers at least.
pub(super) const FIFO: usize = CardKind::Comedi.capabilities().fifo_depth;

/// A device, and what is read from it with each batch of scans.
#[derive(Debug)]
pub(super) struct Board {
    pub(super) device: Device,
    pub(super) readings: InstructionList,
}

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

/// A counter at an encoder.
#[derive(Debug)]
pub(super) struct Counter {
    board: usize,
    subdevice: Subdevice,
    channel: u32,
    mode: CounterMode,
    terminals: Option<[u32; 2]>,
    place: Place,
    count: UnwrappedCount,
}

/// Digital lines that are read with each batch.
#[derive(Debug)]
pub(super) struct Lines {
    board: usize,
    place: Place,
    subdevice: Subdevice,
    first: u32,
    mask: u32,
}

/// Digital lines that are set.
#[derive(Debug)]
pub(super) struct SetLines {
    board: usize,
    subdevice: Subdevice,
    first: u32,
    mask: u32,
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
    motor_power: Option<(Lines, bool)>,
    digital_inputs: Option<Lines>,
    digital_outputs: Option<SetLines>,
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
        let mut boards = Boards(vec![Board { device, readings: InstructionList::default() }]);
        let inputs = inputs(rig, card, &boards.0[0].device)?;
        let outputs = outputs(card, &boards.0[0].device)?;
        if let Some(line) = &card.enable_line {
            boards.lines(card, "comedi.enable_line", line, OUTPUTS)?;
        }
        let motor_power = match &card.motor_power {
            Some(power) => {
                let line = boards.read(card, "comedi.motor_power", &power.line)?;
                Some((line, power.active_low))
            }
            None => None,
        };
        let digital_inputs = match &card.digital_inputs {
            Some(lines) => Some(boards.read(card, "comedi.digital.inputs", lines)?),
            None => None,
        };
        let digital_outputs = match &card.digital_outputs {
            Some(lines) => {
                let (board, subdevice) =
                    boards.lines(card, "comedi.digital.outputs", lines, OUTPUTS)?;
                let mask = lines.mask();
                Some(SetLines { board, subdevice, first: lines.first, mask })
            }
            None => None,
        };
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
            motor_power,
            digital_inputs,
            digital_outputs,
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
        self.set_directions()?;
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

    /// Makes outputs of the lines that are to be such, and checks that no input became one with
    /// them.
    fn set_directions(&self) -> Result<(), ComediError> {
        let channels = |mask: u32| (0..32).filter(move |channel| mask >> channel & 1 == 1);
        if let Some(lines) = &self.digital_outputs {
            let device = &self.boards[lines.board].device;
            for channel in channels(lines.mask) {
                device
                    .make_output(&lines.subdevice, channel)
                    .map_err(device.refused("making a digital line an output"))?;
            }
        }
        let power = self.motor_power.as_ref().map(|(line, _)| ("comedi.motor_power", line));
        let inputs = self.digital_inputs.as_ref().map(|own| ("comedi.digital.inputs", own));
        for (key, lines) in power.into_iter().chain(inputs) {
            let device = &self.boards[lines.board].device;
            for channel in channels(lines.mask) {
                expect_input(device, key, &lines.subdevice, channel)?;
            }
        }
        Ok(())
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
        let boards = &self.boards;
        let masters = master.iter_mut().zip(self.masters.iter_mut().map(Some));
        let slaves = slave.iter_mut().zip(self.slaves.iter_mut().map(Option::as_mut));
        for (to, counter) in masters.chain(slaves) {
            if let Some(counter) = counter {
                let shown = boards[counter.board].readings.word(counter.place);
                *to = counter.count.observe(shown);
            }
        }
        [master, slave]
    }

    fn levels(&self, lines: &Lines) -> u32 {
        (self.boards[lines.board].readings.word(lines.place) & lines.mask) >> lines.first
    }

    /// Levels of the digital inputs that [`Wiring::read`] found, one bit each.
    pub(super) fn digital_in(&self) -> u32 {
        self.digital_inputs.as_ref().map_or(0, |lines| self.levels(lines))
    }

    /// Whether the motor has power, as [`Wiring::read`] found.
    pub(super) fn motor_power(&self) -> bool {
        self.motor_power
            .as_ref()
            .is_some_and(|(line, active_low)| (self.levels(line) == 1) != *active_low)
    }

    /// Whether an input sees if the motor has power.
    pub(super) const fn sees_motor_power(&self) -> bool {
        self.motor_power.is_some()
    }

    /// Number of the digital outputs.
    pub(super) fn digital_outputs(&self) -> u32 {
        self.digital_outputs.as_ref().map_or(0, |lines| lines.mask.count_ones())
    }

    /// Sets the digital outputs, one bit each.
    pub(super) fn set_digital(&self, levels: u32) -> Result<(), comedi::Errno> {
        let Some(lines) = &self.digital_outputs else { return Ok(()) };
        let device = &self.boards[lines.board].device;
        let levels = levels.checked_shl(lines.first).unwrap_or_default();
        device.bits(lines.subdevice.number, lines.mask, levels & lines.mask).map(drop)
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

/// The devices that the wiring names, each opened once.
struct Boards(Vec<Board>);

impl Boards {
    fn board(&mut self, card: &ComediCard, device: &Option<String>) -> Result<usize, ComediError> {
        let node = card.node(device);
        if let Some(at) = self.0.iter().position(|board| board.device.path() == node) {
            return Ok(at);
        }
        let device = Device::open(node)?;
        self.0.push(Board { device, readings: InstructionList::default() });
        Ok(self.0.len() - 1)
    }

    fn lines(
        &mut self,
        card: &ComediCard,
        key: &str,
        own: &DigitalLines,
        kinds: &[Kind],
    ) -> Result<(usize, Subdevice), ComediError> {
        let board = self.board(card, &own.device)?;
        let range = (own.first, own.count);
        Ok((board, lines(&self.0[board].device, key, own.subdevice, range, kinds)?))
    }

    /// Lines that are read with each batch.
    fn read(
        &mut self,
        card: &ComediCard,
        key: &str,
        own: &DigitalLines,
    ) -> Result<Lines, ComediError> {
        let (board, subdevice) = self.lines(card, key, own, INPUTS)?;
        let place = self.0[board].readings.bits(subdevice.number, 0);
        Ok(Lines { board, place, subdevice, first: own.first, mask: own.mask() })
    }

    fn counter(
        &mut self,
        card: &ComediCard,
        key: &str,
        own: &EncoderCounter,
    ) -> Result<Counter, ComediError> {
        // A counter that counts already may be anything that can be read.
        let kinds: &[Kind] = match own.mode {
            CounterMode::Counting => &[Kind::Counter, Kind::AnalogInput, Kind::AnalogOutput],
            _ => &[Kind::Counter],
        };
        let board = self.board(card, &own.device)?;
        let Board { device, readings } = &mut self.0[board];
        let subdevice = device.expect(key, own.subdevice, own.channel, kinds)?;
        let maxdata = device
            .maxdata(&subdevice, own.channel)
            .map_err(device.refused("asking for the size of a counter"))?;
        let place = readings.read(own.subdevice, channel_spec(own.channel, 0, 0));
        Ok(Counter {
            board,
            subdevice,
            channel: own.channel,
            mode: own.mode,
            terminals: own.inputs,
            place,
            count: UnwrappedCount::new(maxdata),
        })
    }
}

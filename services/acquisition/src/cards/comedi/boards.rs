//! The devices that the wiring names, and what is read from each with every batch of scans.

use comedi::{
    ComediError, CounterMode, Device, INPUTS, InstructionList, Kind, Place, Subdevice,
    UnwrappedCount, channel_spec, lines,
};
use rig::{ComediCard, DigitalLines, EncoderCounter};

/// A device, and what is read from it with each batch of scans.
#[derive(Debug)]
pub(super) struct Board {
    pub(super) device: Device,
    pub(super) readings: InstructionList,
    /// Subdevices whose digital lines are among the readings, and where.
    digital: Vec<(u32, Place)>,
}

impl Board {
    fn new(device: Device) -> Self {
        Self { device, readings: InstructionList::default(), digital: Vec::new() }
    }

    /// The place of a subdevice's digital lines among the readings: all of them are read at once.
    fn digital(&mut self, subdevice: u32) -> Place {
        let known = self.digital.iter().find(|(number, _)| *number == subdevice);
        if let Some((_, place)) = known {
            return *place;
        }
        let place = self.readings.bits(subdevice, 0);
        self.digital.push((subdevice, place));
        place
    }
}

/// A counter at an encoder.
#[derive(Debug)]
pub(super) struct Counter {
    pub(super) board: usize,
    pub(super) subdevice: Subdevice,
    pub(super) channel: u32,
    pub(super) mode: CounterMode,
    pub(super) terminals: Option<[u32; 2]>,
    place: Place,
    count: UnwrappedCount,
}

impl Counter {
    /// Follows the counter to what the last reading found.
    pub(super) fn observe(&mut self, boards: &[Board]) -> i64 {
        let shown = boards[self.board].readings.word(self.place);
        self.count.observe(shown)
    }
}

/// Digital lines that are read with each batch.
#[derive(Debug)]
pub(super) struct Lines {
    pub(super) board: usize,
    place: Place,
    pub(super) subdevice: Subdevice,
    first: u32,
    pub(super) mask: u32,
}

impl Lines {
    /// Their levels in the last reading, one bit each.
    pub(super) fn levels(&self, boards: &[Board]) -> u32 {
        (boards[self.board].readings.word(self.place) & self.mask) >> self.first
    }
}

/// The devices that the wiring names, each opened once; the first is the card.
#[derive(Debug)]
pub(super) struct Boards(pub(super) Vec<Board>);

impl Boards {
    pub(super) fn new(card: Device) -> Self {
        Self(vec![Board::new(card)])
    }

    fn board(&mut self, card: &ComediCard, device: &Option<String>) -> Result<usize, ComediError> {
        let node = card.node(device);
        if let Some(at) = self.0.iter().position(|board| board.device.path() == node) {
            return Ok(at);
        }
        self.0.push(Board::new(Device::open(node)?));
        Ok(self.0.len() - 1)
    }

    /// Lines of a subdevice of one of these kinds, and the device that has them.
    pub(super) fn lines(
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
    pub(super) fn read(
        &mut self,
        card: &ComediCard,
        key: &str,
        own: &DigitalLines,
    ) -> Result<Lines, ComediError> {
        let (board, subdevice) = self.lines(card, key, own, INPUTS)?;
        let place = self.0[board].digital(subdevice.number);
        Ok(Lines { board, place, subdevice, first: own.first, mask: own.mask() })
    }

    /// A counter that is read with each batch.
    pub(super) fn counter(
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
        let Board { device, readings, .. } = &mut self.0[board];
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

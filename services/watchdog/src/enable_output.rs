//! The enable line of a real card, which this process switches.
//!
//! The line is the watchdog's own: it has its own open file of the device, and needs no help from
//! acquisition. Edges alone count, so a level means nothing, and a start, an end, or a restart of
//! this process makes none.

use comedi::{ComediError, Errno, OutputLine};
use ipc_types::CardKind;
use rig::RigFile;
use runtime::clock::now_ns;
use thiserror::Error;

/// Calls that are timed when the line is opened.
const TIMED: usize = 64;
/// A line that usually takes longer for a call (ns) would hold up the loop: a card at USB does.
const LONGEST_NS: u64 = 200_000;

/// The enable line cannot be used.
#[derive(Debug, Error)]
pub enum LineError {
    /// There is no such line.
    #[error(transparent)]
    Comedi(#[from] ComediError),
    /// It is too slow.
    #[error(
        "comedi.enable_line: expected a line that takes less than {} µs for a call, found one of \
         {found_us} µs at {device}; take a card within the computer: one at USB cannot do this",
        LONGEST_NS / 1000
    )]
    #[allow(missing_docs)]
    Slow { device: String, found_us: u64 },
    /// It could be used once, and no longer.
    #[error("the motor's enable line: {0}")]
    Lost(Errno),
}

/// A digital output.
pub trait Line {
    /// The level that it has.
    ///
    /// # Errors
    /// The card's.
    fn level(&self) -> Result<bool, Errno>;

    /// Sets the level.
    ///
    /// # Errors
    /// The card's.
    fn set(&self, high: bool) -> Result<(), Errno>;
}

impl Line for OutputLine {
    fn level(&self) -> Result<bool, Errno> {
        self.level()
    }

    fn set(&self, high: bool) -> Result<(), Errno> {
        self.set(high)
    }
}

/// The enable line: a line that goes on from the level that it had.
#[derive(Debug)]
pub struct EnableOutput<L> {
    line: L,
    high: bool,
}

impl EnableOutput<OutputLine> {
    /// Opens the line of the rig's card; `None` where the card is no real one, or drives no motor.
    ///
    /// # Errors
    /// When the line cannot be used.
    pub fn of_rig(card: Option<CardKind>, rig: &RigFile) -> Result<Option<Self>, LineError> {
        let wiring = rig.comedi.as_ref().filter(|_| card == Some(CardKind::Comedi));
        let Some((wiring, line)) = wiring.and_then(|own| Some((own, own.enable_line.as_ref()?)))
        else {
            return Ok(None);
        };
        let node = wiring.node(&line.device);
        let output = OutputLine::open(node, "comedi.enable_line", line.subdevice, line.first)?;
        // The line may have made its neighbours outputs, too.
        for (key, signal) in wiring.signals() {
            if wiring.node(&signal.line.device) == node {
                output.expect_input(&key, signal.line.subdevice, signal.line.first)?;
            }
        }
        let usual_ns = usual_call_ns(&output)?;
        if usual_ns > LONGEST_NS {
            let (device, found_us) = (node.to_owned(), usual_ns / 1000);
            return Err(LineError::Slow { device, found_us });
        }
        Self::new(output).map(Some)
    }
}

impl<L: Line> EnableOutput<L> {
    /// Takes up a line at the level that it has.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn new(line: L) -> Result<Self, LineError> {
        let high = line.level().map_err(LineError::Lost)?;
        Ok(Self { line, high })
    }

    /// Makes an edge.
    ///
    /// # Errors
    /// When the line is lost. It then makes no more edges, which takes the motor's power.
    pub fn toggle(&mut self) -> Result<(), LineError> {
        self.line.set(!self.high).map_err(LineError::Lost)?;
        self.high = !self.high;
        Ok(())
    }
}

/// The median of how long a call takes (ns).
fn usual_call_ns(line: &impl Line) -> Result<u64, LineError> {
    let mut taken = [0; TIMED];
    for to in &mut taken {
        let begun = now_ns();
        line.level().map_err(LineError::Lost)?;
        *to = now_ns().saturating_sub(begun);
    }
    taken.sort_unstable();
    Ok(taken[TIMED / 2])
}

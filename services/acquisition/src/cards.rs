//! The cards that acquisition can be started with: one table, from the kind to its driver.

mod comedi;
mod null;
mod replay;
mod simulated;

use std::path::PathBuf;

pub use self::comedi::{CheckedComedi, ComediDaq};
use ::comedi::ComediError;
use ipc_types::CardKind;
pub use null::NullDaq;
pub use replay::{ReplayDaq, ReplayError};
use rig::{ComediCard, RigFile};
use runtime::daq::Daq;
use runtime::{DomainError, PortError, Service};
pub use simulated::SimulatedDaq;
use thiserror::Error;

/// The drivers. A kind of card that is not among them cannot be chosen.
pub const DRIVERS: &[Driver] = &[
    Driver {
        kind: CardKind::Simulated,
        open: |_, _| Ok(Box::new(|service, rig| Ok(Box::new(SimulatedDaq::new(service, rig)?)))),
    },
    Driver {
        kind: CardKind::Replay,
        open: |options, rig| {
            let record = options.replay.as_ref().ok_or(CardError::NoRecord)?;
            Ok(ready(ReplayDaq::open(record, rig, options.looped)?))
        },
    },
    Driver {
        kind: CardKind::Null,
        open: |_, rig| Ok(ready(NullDaq::new(rig.rates.acquisition_hz))),
    },
    Driver {
        kind: CardKind::Comedi,
        open: |_, rig| {
            let card = rig.comedi.as_ref();
            let card = card.ok_or_else(|| CardError::NoWiring(rig.file_name().to_owned()))?;
            let checked = CheckedComedi::open(rig, card)?;
            Ok(Box::new(|service, _| {
                let directory = service.domain().name().make_run_directory()?;
                Ok(Box::new(checked.start(Some(&directory))?))
            }))
        },
    },
];

/// Opens the cards of one kind.
#[derive(Clone, Copy, Debug)]
pub struct Driver {
    /// The kind.
    pub kind: CardKind,
    /// Checks options and rig file before the process joins the rig; what reads a file or a device
    /// does so here.
    pub open: fn(&CardOptions, &RigFile) -> Result<Opened, CardError>,
}

/// A card that was opened: the rest is done when the process has joined the rig.
pub type Opened = Box<dyn FnOnce(&Service, &RigFile) -> Result<Box<dyn Daq>, StartError>>;

/// A card that was checked cannot be taken into use now; a restart may help.
#[derive(Debug, Error)]
#[allow(missing_docs)]
pub enum StartError {
    #[error(transparent)]
    Port(#[from] PortError),
    #[error(transparent)]
    Domain(#[from] DomainError),
    #[error(transparent)]
    Comedi(#[from] ComediError),
}

/// A card that needs nothing of the rig.
fn ready(card: impl Daq + 'static) -> Opened {
    Box::new(|_, _| Ok(Box::new(card)))
}

/// Which card, and what its driver is told.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CardOptions {
    /// The kind of card.
    pub kind: CardKind,
    /// Measured record (MCAP or CSV), for the replay.
    pub replay: Option<PathBuf>,
    /// Whether the record begins again at its end.
    pub looped: bool,
}

impl CardOptions {
    /// A card that needs no further options.
    pub const fn of(kind: CardKind) -> Self {
        Self { kind, replay: None, looped: false }
    }

    /// Opens the card for a rig.
    ///
    /// # Errors
    /// When there is no driver, an option is missing, or the card does not fit the rig.
    pub fn open(&self, rig: &RigFile) -> Result<Opened, CardError> {
        let comedi = rig.comedi.as_ref().filter(|_| self.kind == CardKind::Comedi);
        let capabilities = self.kind.capabilities();
        // A comedi card has the outputs that the rig file wires.
        if comedi.map_or(capabilities.accepts_output, ComediCard::has_outputs) {
            rig.check_homing()?;
        }
        if capabilities.accepts_output {
            let wired = |card: &ComediCard| card.digital_outputs.as_ref().map_or(0, |it| it.count);
            let outputs = comedi.map_or(capabilities.digital_outputs, wired);
            if let Some(sync) = rig.sync.filter(|sync| sync.output >= outputs) {
                let (kind, output) = (self.kind, sync.output);
                return Err(CardError::NoDigitalOutput { kind, output, outputs });
            }
        }
        let driver = DRIVERS.iter().find(|driver| driver.kind == self.kind);
        (driver.ok_or(CardError::NoDriver(self.kind))?.open)(self, rig)
    }
}

/// A card cannot be opened.
#[derive(Debug, Error)]
pub enum CardError {
    /// There is none for this kind of card.
    #[error("this build has no driver for card {0}")]
    NoDriver(CardKind),
    /// An axis does not say how it finds its zero.
    #[error(transparent)]
    Rig(#[from] rig::RigError),
    /// The rig file names a digital output that the card does not have.
    #[error(
        "sync.output: expected one of the {outputs} digital outputs of card {kind}, from 0, found \
         {output}; name another, or take [sync] out"
    )]
    #[allow(missing_docs)]
    NoDigitalOutput { kind: CardKind, output: u32, outputs: u32 },
    /// The rig file does not say how the card is wired.
    #[error(
        "{0}: comedi: expected a section [comedi] with the wiring of the card, found none; \
             see docs/comedi.md"
    )]
    NoWiring(String),
    /// The card is not what the rig file says.
    #[error(transparent)]
    Comedi(#[from] ComediError),
    /// The replay has nothing to replay.
    #[error("--card replay: --replay RECORD is missing")]
    NoRecord,
    /// The record cannot be replayed on this rig.
    #[error(transparent)]
    Replay(#[from] ReplayError),
}

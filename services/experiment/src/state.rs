//! The state that the experiment process keeps on disk for a restart.

use files::{Format, FormatError};
use ipc_types::PulseSource;
use serde::{Deserialize, Serialize};

use crate::ilc_update::IlcState;
use crate::scan_tracker::ScanState;
use crate::session_state::SessionState;

const FORMAT: Format = Format { what: "state of the experiment", mark: *b"FRPS", version: 6 };

/// The file that holds the state of a learning run.
const LEARNING: Format = Format { what: "state of learning", mark: *b"FRLS", version: 1 };

/// Progress of a protocol: its text, and the segment being played.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlayerState {
    /// Session of the rig; a state of another session is not resumed.
    pub session: u64,
    /// Name under which the protocol was asked for.
    pub name: String,
    /// Its text, overrides applied.
    pub text: String,
    /// Identity of the text.
    pub protocol: u64,
    /// Index of the segment being played, repeats counted.
    pub segment: u32,
    /// Whether it was being played.
    pub running: bool,
    /// Enable epoch in which it was started; it may continue only in this one.
    pub epoch: u64,
    /// The client that started it and must renew its lease.
    pub client: u64,
    /// Where the scanner's pulses come from.
    pub pulses: PulseSource,
    /// The scanner, as far as it was followed at the segment's beginning.
    pub scan: ScanState,
    /// When the key 5 was pressed as the scanner's pulse since then (ns, CLOCK_MONOTONIC), the
    /// newest.
    pub keys: Vec<u64>,
    /// The sessions so far.
    pub sessions: SessionState,
}

/// Why bytes are not a valid state, or why a state cannot be encoded.
#[derive(Debug, thiserror::Error)]
#[error("{0}; delete the file and start the protocol anew")]
pub struct StateError(pub FormatError);

impl PlayerState {
    /// Encodes the state.
    ///
    /// # Errors
    /// [`FormatError::Coding`] if the encoder fails.
    pub fn encode(&self) -> Result<Vec<u8>, StateError> {
        FORMAT.encode(self).map_err(StateError)
    }

    /// Decodes a state.
    ///
    /// # Errors
    /// Each [`FormatError`]: a damaged file never yields a state, nor does one of another version.
    pub fn decode(bytes: &[u8]) -> Result<Self, StateError> {
        let state: Self = FORMAT.decode(bytes).map_err(StateError)?;
        state.checked(FORMAT.what).map_err(StateError)
    }

    /// The state, where it can be gone on with; `what` is what was read.
    pub(crate) fn checked(self, what: &'static str) -> Result<Self, FormatError> {
        match self.scan.is_possible() {
            true => Ok(self),
            false => {
                let reason = "expected times and counts of a scanner, found impossible ones";
                Err(FormatError::Coding { what, reason: reason.to_owned() })
            }
        }
    }
}

impl IlcState {
    /// Encodes the state.
    ///
    /// # Errors
    /// [`FormatError::Coding`] if the encoder fails.
    pub fn encode(&self) -> Result<Vec<u8>, FormatError> {
        LEARNING.encode(self)
    }

    /// Decodes a state.
    ///
    /// # Errors
    /// Each [`FormatError`]: a damaged file never yields a state, nor does one of another version.
    pub fn decode(bytes: &[u8]) -> Result<Self, FormatError> {
        LEARNING.decode(bytes)
    }
}

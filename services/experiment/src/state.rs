//! The state that the experiment process keeps on disk for a restart.

use files::{Format, FormatError};
use serde::{Deserialize, Serialize};

use crate::scan_tracker::ScanState;
use crate::session_state::SessionState;

const FORMAT: Format = Format { what: "state of the experiment", mark: *b"FRPS", version: 4 };

/// Progress of a protocol: its text, and the segment being played.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlayerState {
    /// Session of the rig; a state of another session is not resumed.
    pub session: u64,
    /// Name of the protocol.
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
    /// The scanner, as far as it was followed at the segment's beginning.
    pub scan: ScanState,
    /// The sessions so far.
    pub sessions: SessionState,
}

/// The fields of version 1, without epoch and client: such a protocol is not resumed, nor one of
/// version 2, which has no scanner, or 3, which has no sessions.
#[derive(Deserialize)]
struct Version1 {
    session: u64,
    name: String,
    text: String,
    protocol: u64,
    segment: u32,
    #[allow(dead_code)]
    running: bool,
}

/// The fields of version 2.
#[derive(Deserialize)]
struct Version2 {
    first: Version1,
    #[allow(dead_code)]
    epoch: u64,
    #[allow(dead_code)]
    client: u64,
}

/// The fields of version 3.
#[derive(Deserialize)]
struct Version3 {
    first: Version2,
    #[allow(dead_code)]
    scan: ScanState,
}

impl From<Version1> for PlayerState {
    fn from(old: Version1) -> Self {
        let Version1 { session, name, text, protocol, segment, .. } = old;
        let (running, epoch, client) = (false, 0, 0);
        Self {
            session,
            name,
            text,
            protocol,
            segment,
            running,
            epoch,
            client,
            scan: ScanState::default(),
            sessions: SessionState::default(),
        }
    }
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
    /// Each [`FormatError`]; a damaged file never yields a state.
    pub fn decode(bytes: &[u8]) -> Result<Self, StateError> {
        match FORMAT.decode(bytes) {
            Err(FormatError::Version { found: 1, .. }) => {
                Format { version: 1, ..FORMAT }.decode::<Version1>(bytes).map(Self::from)
            }
            Err(FormatError::Version { found: 2, .. }) => {
                let old = Format { version: 2, ..FORMAT }.decode::<Version2>(bytes);
                old.map(|old| Self::from(old.first))
            }
            Err(FormatError::Version { found: 3, .. }) => {
                let old = Format { version: 3, ..FORMAT }.decode::<Version3>(bytes);
                old.map(|old| Self::from(old.first.first))
            }
            decoded => decoded,
        }
        .map_err(StateError)
    }
}

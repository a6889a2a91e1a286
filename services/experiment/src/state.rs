//! The state that the experiment process keeps on disk for a restart.
//!
//! Format: a mark of 4 bytes, a version of 2, a checksum of 8 (FNV-1a over the rest), then the
//! state in bincode. bincode is unmaintained; the version allows another encoding to replace it.

use serde::{Deserialize, Serialize};

const MARK: [u8; 4] = *b"FRPS";
const VERSION: u16 = 2;
const HEADER: usize = MARK.len() + 2 + 8;
/// Largest size of the encoded state (bytes).
const LONGEST: usize = 16 << 20;

/// Progress of a protocol: its text, and the segment being played.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
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
}

/// The fields of version 1, without epoch and client: such a protocol is not resumed.
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

impl From<Version1> for PlayerState {
    fn from(old: Version1) -> Self {
        let Version1 { session, name, text, protocol, segment, .. } = old;
        Self { session, name, text, protocol, segment, running: false, epoch: 0, client: 0 }
    }
}

/// Why bytes are not a valid state.
#[derive(Debug, thiserror::Error)]
pub enum StateError {
    /// Truncated, or not a state at all.
    #[error(
        "no state of the experiment: expected {HEADER} bytes that begin with \"FRPS\", found \
            {found}; delete the file"
    )]
    NotAState {
        /// What was found.
        found: String,
    },
    /// Written by another version.
    #[error(
        "state of version {found}, this build reads version {VERSION}; delete the file and restart \
            the protocol anew"
    )]
    Version {
        /// Version in the file.
        found: u16,
    },
    /// Damaged.
    #[error(
        "state is damaged: expected checksum {expected:016x}, found {found:016x}; delete the file \
            and start the protocol anew"
    )]
    Checksum {
        /// Checksum in the file.
        expected: u64,
        /// Checksum of the bytes.
        found: u64,
    },
    /// An intact file that does not decode, or a state that does not encode.
    #[error("state cannot be coded: {0}; delete the file and start the protocol anew")]
    Coding(String),
}

impl PlayerState {
    /// Encodes the state.
    ///
    /// # Errors
    /// [`StateError::Coding`] if the encoder fails.
    pub fn encode(&self) -> Result<Vec<u8>, StateError> {
        let body = bincode::serde::encode_to_vec(self, bincode::config::standard())
            .map_err(|error| StateError::Coding(error.to_string()))?;
        let mut bytes = Vec::with_capacity(HEADER + body.len());
        bytes.extend_from_slice(&MARK);
        bytes.extend_from_slice(&VERSION.to_le_bytes());
        bytes.extend_from_slice(&rig::identity_of_bytes(&body).to_le_bytes());
        bytes.extend_from_slice(&body);
        Ok(bytes)
    }

    /// Decodes a state.
    ///
    /// # Errors
    /// Each [`StateError`]; a damaged file never yields a state.
    pub fn decode(bytes: &[u8]) -> Result<Self, StateError> {
        let not_a_state = || StateError::NotAState { found: format!("{} bytes", bytes.len()) };
        let (header, body) = bytes.split_at_checked(HEADER).ok_or_else(not_a_state)?;
        let (mark, header) = header.split_first_chunk::<4>().ok_or_else(not_a_state)?;
        let (version, checksum) = header.split_first_chunk::<2>().ok_or_else(not_a_state)?;
        let checksum = checksum.first_chunk::<8>().ok_or_else(not_a_state)?;
        if *mark != MARK {
            return Err(StateError::NotAState { found: format!("\"{}\"", mark.escape_ascii()) });
        }
        let version = u16::from_le_bytes(*version);
        if !matches!(version, 1 | VERSION) {
            return Err(StateError::Version { found: version });
        }
        let (expected, found) = (u64::from_le_bytes(*checksum), rig::identity_of_bytes(body));
        if expected != found {
            return Err(StateError::Checksum { expected, found });
        }
        let config = bincode::config::standard().with_limit::<LONGEST>();
        let decoded = match version {
            1 => bincode::serde::decode_from_slice::<Version1, _>(body, config)
                .map(|(old, read)| (old.into(), read)),
            _ => bincode::serde::decode_from_slice(body, config),
        };
        let (state, read) = decoded.map_err(|error| StateError::Coding(error.to_string()))?;
        if read != body.len() {
            return Err(StateError::Coding(format!("{} bytes too many", body.len() - read)));
        }
        Ok(state)
    }
}

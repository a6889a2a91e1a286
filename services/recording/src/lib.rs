//! Reading and writing of recordings: MCAP files of the rig's messages, and the measured records
//! (CSV or MCAP) that identification and replay work on.
//!
//! - [`mcap_write`]: the logger's writer. A killed logger leaves a readable file.
//! - [`mcap_read`]: reads such files, whole or torn, also those of older builds.
//! - [`mcap_edit`]: recover, cut and merge.
//! - [`channel`]: how a topic is described to other programs, and its messages encoded.
//! - [`record`]: a measured record, column by column, checked before use.
//! - [`mod@column`]: columns that may be longer than the memory.
//! - [`replaced`]: what a recording says of processes in whose place programs of others run.
//! - [`schema`]: the layout of messages, from the schemas in the recording.
//!
//! Nothing here reads a clock: times come in as arguments, in ns.
#![forbid(unsafe_code)]

pub mod channel;
pub mod column;
pub mod mcap_edit;
pub mod mcap_read;
pub mod mcap_write;
mod parts;
pub mod record;
mod record_checksum;
mod related;
pub mod replaced;
pub mod schema;

pub use parts::{part_path, parts_of};

/// The little-endian word at byte `at`; 0 beyond the end.
pub fn word(bytes: &[u8], at: usize) -> u64 {
    let mut raw = [0u8; 8];
    if let Some(slice) = bytes.get(at..at + 8) {
        raw.copy_from_slice(slice);
    }
    u64::from_le_bytes(raw)
}

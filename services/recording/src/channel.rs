//! How a topic is described and its messages are laid out for other people's programs: in a
//! recording, and to viewers of a running rig.

use std::collections::BTreeMap;

use ipc_types::{CDR_HEADER, Topic};

/// Language of the schemas.
pub const SCHEMA_ENCODING: &str = "ros2msg";
/// Encoding of the messages.
pub const MESSAGE_ENCODING: &str = "cdr";

/// What is said of a topic beside its schema: its owner, and its type in shared memory.
pub fn about(topic: &Topic) -> BTreeMap<String, String> {
    BTreeMap::from([
        ("owner".to_owned(), topic.owner.text().to_owned()),
        ("type".to_owned(), topic.type_name.to_owned()),
    ])
}

/// Appends a message, given as its bytes in shared memory, in [`MESSAGE_ENCODING`].
pub fn put_payload(bytes: &[u8], into: &mut Vec<u8>) {
    into.extend_from_slice(&CDR_HEADER);
    into.extend_from_slice(bytes);
}

/// A time of `CLOCK_MONOTONIC` (ns) as ns since 1970, by an offset between the two clocks (ns).
pub const fn wall_time_ns(time_ns: u64, realtime_offset_ns: i64) -> u64 {
    time_ns.saturating_add_signed(realtime_offset_ns)
}

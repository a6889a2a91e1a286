//! Shared-memory capacity: what a rig needs, and whether it is free.

use std::path::Path;

use ipc_types::{COMMAND_SERVICES, TOPICS};

use super::error::{DomainError, at};
use crate::shared_memory::{MEBIBYTE, SHARED_MEMORY};
use crate::{ports, request};

/// What a rig needs in shared memory once every page is in use (bytes); where memory is locked,
/// that is from the start.
fn needed_bytes() -> u64 {
    // The library's header in front of each message, and its alignment.
    const HEADER: usize = 64;
    // Connections and tables of the library, the launcher's files.
    const REST: u64 = 4 * MEBIBYTE;
    let topics: usize =
        TOPICS.iter().map(|topic| ports::messages_in_segment(topic) * (topic.size + HEADER)).sum();
    let servers: usize = COMMAND_SERVICES
        .iter()
        .map(|service| request::ANSWERS_IN_SEGMENT * (service.bytes + HEADER))
        .sum();
    let all = (topics + servers) as u64 + REST;
    // The segments of a process that was killed a moment ago stay while its successor makes its
    // own.
    all + all / 4
}

/// What a rig needs in shared memory, and what is free there (bytes).
///
/// # Errors
/// Where the free space cannot be read.
pub fn shared_memory_room() -> Result<(u64, u64), DomainError> {
    let found = rustix::fs::statvfs(SHARED_MEMORY)
        .map_err(|error| at("looking for free space in", Path::new(SHARED_MEMORY))(error.into()))?;
    // A tmpfs without a limit says that it has no blocks at all.
    let free =
        if found.f_blocks == 0 { u64::MAX } else { found.f_bavail.saturating_mul(found.f_frsize) };
    Ok((needed_bytes(), free))
}

/// Refuses to found a domain that would not fit.
pub(super) fn check_capacity() -> Result<(), DomainError> {
    let (needed, free) = shared_memory_room()?;
    fits(needed, free)
}

fn fits(needed: u64, found: u64) -> Result<(), DomainError> {
    if found < needed { Err(DomainError::NoRoom { needed, found }) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rig_fits_into_what_containers_have_and_says_what_it_lacks() {
        let needed = needed_bytes();
        // What the segments of a running rig were measured to be, and the usual size in a
        // container.
        assert!((30 * MEBIBYTE..64 * MEBIBYTE).contains(&needed), "{needed}");
        assert!(fits(needed, needed).is_ok());
        let error = fits(needed, 3 * MEBIBYTE).unwrap_err().to_string();
        assert!(error.contains("/dev/shm, found 3 MiB free"), "{error}");
    }
}

//! Where the segments of a rig live.

/// Where POSIX shared memory lives on Linux.
pub const SHARED_MEMORY: &str = "/dev/shm";

/// Bytes in a mebibyte.
pub(crate) const MEBIBYTE: u64 = 1 << 20;

//! Who sends: session of the rig, incarnation of the process.

/// Session and incarnation of a sender.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Identity {
    /// Drawn by the keeper at each cold start.
    pub session: u64,
    /// Drawn at each process start.
    pub incarnation: u64,
}

/// A random number that is never 0 (0 means "nobody").
pub fn random_u64() -> u64 {
    rand::random::<u64>().max(1)
}

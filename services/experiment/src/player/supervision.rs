//! Whether a protocol may continue: the enable epoch under which it was started, and its client's
//! lease.
//!
//! A protocol belongs to one enable epoch of the watchdog. Every trip, emergency stop and disarm
//! ends that epoch for good, and the protocol with it: a later `enable` has a higher epoch and does
//! not resume it. A protocol also belongs to the client that started it, which renews a lease with
//! its requests; when the lease expires, the handle is brought to rest and held before the output
//! goes to 0 V.
//!
//! After a restart of the experiment process nothing moves until the watchdog's newest token shows
//! the same epoch and the client has renewed its lease.

/// What the watchdog allows, from its newest token.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Permission {
    /// No token has arrived since this process started.
    Unknown,
    /// The motor is enabled, in this epoch.
    Enabled(u64),
    /// The motor is not enabled, or the watchdog has fallen silent.
    Withdrawn,
}

/// The outcome of a check.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    /// The protocol goes on.
    Continue,
    /// A resumed protocol waits for the first token, or for its client.
    Wait,
    /// Permission was withdrawn.
    PermissionLost,
    /// The client's lease has lapsed.
    ClientGone,
}

/// Supervises one run of a protocol.
#[derive(Clone, Copy, Debug)]
pub(super) struct Supervision {
    /// The epoch that the run belongs to.
    epoch: u64,
    /// Whether the run was resumed after a restart.
    resumed: bool,
    /// First check (ns).
    since_ns: Option<u64>,
}

impl Supervision {
    pub(super) const fn new(epoch: u64, resumed: bool) -> Self {
        Self { epoch, resumed, since_ns: None }
    }

    pub(super) const fn epoch(&self) -> u64 {
        self.epoch
    }

    /// First check (ns, CLOCK_MONOTONIC); 0 before it.
    pub(super) fn since_ns(&self) -> u64 {
        self.since_ns.unwrap_or(0)
    }

    /// Checks at `now_ns`; the client last renewed its lease at `renewed_ns` (0: not yet), and the
    /// lease lasts `lease_ns` (CLOCK_MONOTONIC).
    pub(super) fn check(
        &mut self,
        now_ns: u64,
        permission: Permission,
        renewed_ns: u64,
        lease_ns: u64,
    ) -> Verdict {
        let since_ns = *self.since_ns.get_or_insert(now_ns);
        let unknown = match permission {
            Permission::Enabled(epoch) if epoch == self.epoch => false,
            Permission::Unknown if self.resumed && now_ns.saturating_sub(since_ns) <= lease_ns => {
                true
            }
            _ => return Verdict::PermissionLost,
        };
        if now_ns.saturating_sub(renewed_ns.max(since_ns)) > lease_ns {
            return Verdict::ClientGone;
        }
        if unknown || (self.resumed && renewed_ns < since_ns) {
            return Verdict::Wait;
        }
        Verdict::Continue
    }
}

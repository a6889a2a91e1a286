//! Whether the logger lives, by its heartbeats.

use ipc_types::Heartbeat;
use runtime::clock::SECOND_NS;
use runtime::{PortError, Subscriber};

use crate::since::Since;

/// Silence after which the logger is lost (ns): 40 of its heartbeats, so that a slow disk or a
/// stall of the host is none.
const LOST_NS: u64 = 2 * SECOND_NS;

/// When the logger was last heard.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Silence {
    since: Since,
}

impl Silence {
    /// Takes whether a heartbeat has come; returns whether the logger lives. A rig that comes up
    /// has as long as one that goes on.
    pub(crate) fn alive(&mut self, heard: bool, now_ns: u64) -> bool {
        self.since.elapsed_ns(heard, now_ns) <= LOST_NS
    }
}

/// Listens to the logger's heartbeats.
pub(crate) struct LoggerWatch {
    heartbeats: Subscriber<Heartbeat>,
    silence: Silence,
}

impl LoggerWatch {
    pub(crate) fn new(heartbeats: Subscriber<Heartbeat>) -> Self {
        Self { heartbeats, silence: Silence::default() }
    }

    /// Whether it lives.
    pub(crate) fn alive(&mut self, now_ns: u64) -> Result<bool, PortError> {
        let heard = self.heartbeats.latest()?.is_some();
        Ok(self.silence.alive(heard, now_ns))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lost_after_two_seconds_of_silence_and_back_with_the_next_heartbeat() {
        let mut silence = Silence::default();
        assert!(silence.alive(false, 10 * SECOND_NS), "its time begins with the first look");
        assert!(silence.alive(false, 12 * SECOND_NS));
        assert!(!silence.alive(false, 12 * SECOND_NS + 1));
        assert!(silence.alive(true, 13 * SECOND_NS));
        assert!(silence.alive(false, 15 * SECOND_NS));
        assert!(!silence.alive(false, 15 * SECOND_NS + 1));
    }
}

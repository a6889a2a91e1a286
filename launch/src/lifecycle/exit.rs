//! How a process ended.

use std::fmt;

use serde::{Deserialize, Serialize};
use signal_hook::consts::{SIGHUP, SIGINT, SIGPIPE, SIGTERM};
use signal_hook::low_level::signal_name;

/// How a process ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Exit {
    /// It returned this code.
    Code(i32),
    /// This signal ended it.
    Signal(i32),
    /// The process was adopted: the kernel reports its end, but not its exit code.
    Unknown,
}

impl Exit {
    /// Whether it is a clean exit, as in systemd: code 0, SIGHUP, SIGINT, SIGTERM or SIGPIPE.
    pub fn is_clean(self) -> bool {
        match self {
            Self::Code(code) => code == 0,
            Self::Signal(signal) => [SIGHUP, SIGINT, SIGTERM, SIGPIPE].contains(&signal),
            Self::Unknown => false,
        }
    }
}

impl fmt::Display for Exit {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Code(code) => write!(formatter, "exit code {code}"),
            Self::Signal(signal) => match signal_name(*signal) {
                Some(name) => write!(formatter, "signal {signal} ({name})"),
                None => write!(formatter, "signal {signal}"),
            },
            Self::Unknown => write!(formatter, "unknown (the process was adopted)"),
        }
    }
}

//! The kinds of card behind acquisition, and what each can do.

use crate::codes::codes;

/// Scans in the simulated card's FIFO.
pub const CARD_FIFO: usize = 512;

/// What a scan of the simulated card holds in place of the count of an encoder that does not
/// answer.
pub const ABSENT_COUNT: i64 = i64::MIN;

/// Whether the simulated card filled a scan in: it was not run in time, and simulated the tick a
/// period of the grid or more after it. Takes the time of publishing, that of the scan, and the
/// period (ns).
pub const fn is_filled_in(time_ns: u64, scan_time_ns: u64, period_ns: u64) -> bool {
    time_ns.saturating_sub(scan_time_ns) >= period_ns
}

codes! {
    /// The card behind acquisition. Its name is the value of `--card`.
    CardKind {
        /// The simulator process.
        Simulated = 0, "simulated";
        /// A measured record.
        Replay = 1, "replay";
        /// No card: samples without data, no output.
        Null = 2, "null";
        /// A real card.
        Hardware = 3, "hardware";
        /// A real card with a Linux comedi driver.
        Comedi = 4, "comedi";
    }
}

/// What a card can do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Capabilities {
    /// Scans that the card buffers; older ones are dropped, and counted.
    pub fifo_depth: usize,
    /// Whether volts can be written.
    pub accepts_output: bool,
    /// Digital outputs that are free for signals to other instruments.
    pub digital_outputs: u32,
    /// Whether the outputs hold their last value when the process that wrote them dies.
    pub holds_on_exit: bool,
    /// Who drives the edges of the enable line; `None` for a card that does not drop the motor by
    /// itself when the line stops toggling.
    pub enable_line: Option<LineDriver>,
    /// Whether its scans tell if the motor has power. A comedi card does where the rig file wires a
    /// contact of the relay to it.
    pub reports_power: bool,
    /// Whether it moves a real machine: it then arms in the realtime profile only.
    pub real: bool,
}

/// Who drives the edges of the enable line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LineDriver {
    /// The card takes the watchdog's line directly.
    Watchdog,
    /// Acquisition passes the watchdog's edges on to a digital output of its card.
    Acquisition,
}

impl CardKind {
    /// What cards of this kind can do: the one table that acquisition and watchdog share. A real
    /// card has no enable line, and does not arm, until its entry names who drives the edges.
    pub const fn capabilities(self) -> Capabilities {
        let none = Capabilities {
            fifo_depth: 512,
            accepts_output: false,
            digital_outputs: 0,
            holds_on_exit: false,
            enable_line: None,
            reports_power: false,
            real: false,
        };
        match self {
            Self::Simulated => Capabilities {
                fifo_depth: CARD_FIFO,
                accepts_output: true,
                digital_outputs: 8,
                holds_on_exit: true,
                enable_line: Some(LineDriver::Watchdog),
                reports_power: true,
                ..none
            },
            // A file drops nothing.
            Self::Replay => Capabilities { fifo_depth: 1 << 20, ..none },
            Self::Null => none,
            Self::Hardware => {
                Capabilities { accepts_output: true, holds_on_exit: true, real: true, ..none }
            }
            // A rig file gives motors to it only with an enable line and the sight of their power.
            Self::Comedi => Capabilities {
                accepts_output: true,
                digital_outputs: 8,
                holds_on_exit: true,
                enable_line: Some(LineDriver::Watchdog),
                reports_power: true,
                real: true,
                ..none
            },
        }
    }
}

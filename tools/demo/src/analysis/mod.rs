//! Computes every reported number from the recording and the times of the kills.
//!
//! Pure functions, without clock or rig: whoever has the recording can check every number.

mod declared_model_error;
mod message_loss;
mod recorded_messages;
mod timing;

pub use declared_model_error::{Model, model};
pub use message_loss::{Losses, TopicLoss, losses};
pub use operator::status::Percentiles;
pub use recorded_messages::Trace;
pub(crate) use recorded_messages::{master, slave};
pub use timing::{
    OfLoops, Outage, Rate, Timing, Trip, command_rates, missed_periods, of_loops, outage, profile,
    sample_to_command, unpowered_spans, unprovoked,
};

use ipc_types::Process;
use rig::RigFile;

/// A process that was killed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Kill {
    /// Which.
    pub process: Process,
    /// Just before the signal was sent (ns, CLOCK_MONOTONIC).
    pub at_ns: u64,
}

/// Everything that is reported of one run.
#[derive(Debug)]
pub struct Analysis {
    /// The recorded messages.
    pub trace: Trace,
    /// What is missing of it.
    pub losses: Losses,
    /// Timing of the processes.
    pub timing: Timing,
    /// Effects of each kill, in order.
    pub outages: Vec<Outage>,
    /// Trips that no kill explains, usually because the host delayed a loop beyond its deadline.
    pub unprovoked: Vec<Trip>,
    /// The declared model's simulation; `None` where the rig file declares none that can be
    /// simulated.
    pub model: Option<Model>,
}

/// Longest recovery of a working system after a kill (ns).
const RECOVERY_NS: u64 = 15_000_000_000;

impl Analysis {
    /// Whether the recording shows what followed a kill: it was ended in good order, or goes on for
    /// long enough.
    pub(crate) fn recorded_after(&self, kill: &Kill) -> bool {
        let end_ns = self.trace.scans.last().map_or(0, |scan| scan.scan_time_ns);
        self.losses.sound || end_ns >= kill.at_ns + RECOVERY_NS
    }
}

/// Analyses a recording.
///
/// # Errors
/// Where the declared model cannot be simulated although it is of a kind that can.
pub fn analyse(trace: Trace, kills: &[Kill], rig: &RigFile) -> anyhow::Result<Analysis> {
    let outages = kills
        .iter()
        .enumerate()
        .map(|(index, kill)| outage(&trace, *kill, kills.get(index + 1).map(|next| next.at_ns)))
        .collect();
    Ok(Analysis {
        unprovoked: unprovoked(&trace.tokens, kills),
        losses: losses(&trace),
        timing: Timing::of(&trace),
        outages,
        model: model(&trace.samples, rig)?,
        trace,
    })
}

//! `summary.json`, the results for programs.

use std::collections::BTreeMap;

use ipc_types::Process;
use serde::Serialize;

use crate::analysis::{Analysis, OfLoops, Percentiles};
use crate::closed_loop::{ClosedLoop, ClosedLoopSummary};
use crate::identify_result::IdentifyResult;

/// The results of one run. Their names and meaning are an interface to other programs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// Git revision of the build, or its version where it was built outside a checkout.
    pub revision: String,
    /// `realtime` or `best-effort`.
    pub profile: String,
    /// The effect that was put into the simulated plant, as `ID@SITE=SIZE`; null for none.
    pub injected: Option<String>,
    /// Samples on disk.
    pub samples: u64,
    /// Samples published that are not on disk.
    pub samples_lost: u64,
    /// Ticks of the grid that acquisition never published.
    pub samples_missed: u64,
    /// Commands a second of each incarnation of control.
    pub command_hz: Vec<f64>,
    /// Periods skipped, by process.
    pub missed_periods: BTreeMap<Process, u64>,
    /// Wake lateness: the worst of all processes, and each in `by_process` (µs).
    pub wake_late_us: OfLoops,
    /// Execution time of a cycle, likewise (µs).
    pub cycle_us: OfLoops,
    /// From the scan of a sample to the command that answers it (µs).
    pub sample_to_command_us: Percentiles,
    /// From each kill to the card's first step at 0 V (ms); null where the motor was not at 0 V
    /// before power was enabled again.
    pub trip_ms: Vec<Option<f64>>,
    /// From each kill to the first valid message of the next incarnation (ms); null where none
    /// came.
    pub restart_ms: Vec<Option<f64>>,
    /// Size of `run.mcap`.
    pub recording_bytes: u64,
    /// Root mean square of measured against declared model, by channel (rad, N·m).
    pub model_error: BTreeMap<&'static str, f64>,
    /// As `farreach identify --json`, of this recording; null where it was left out or could not be
    /// run.
    pub identify: Option<serde_json::Value>,
    /// The loop closed on the rig: what was found, tracking error before and after; null where it
    /// was left out or could not be closed.
    pub closed_loop: Option<ClosedLoopSummary>,
    /// Why it could not be run; null where it was, or was left out.
    pub identify_refused: Option<String>,
}

impl Summary {
    /// Of one run.
    pub fn new(analysis: &Analysis, injected: Option<&str>) -> Self {
        let (losses, timing) = (&analysis.losses, &analysis.timing);
        let own =
            || option_env!("FARREACH_REVISION").unwrap_or(env!("CARGO_PKG_VERSION")).to_owned();
        Self {
            revision: analysis
                .trace
                .revision
                .clone()
                .filter(|text| !text.is_empty())
                .unwrap_or_else(own),
            profile: timing.profile.text().to_owned(),
            injected: injected.map(str::to_owned),
            samples: losses.samples,
            samples_lost: losses.samples_lost,
            samples_missed: losses.samples_missed,
            command_hz: timing.command_rates.iter().map(|rate| rate.hz).collect(),
            missed_periods: timing.missed_periods.clone(),
            wake_late_us: timing.wake_late.clone(),
            cycle_us: timing.cycle.clone(),
            sample_to_command_us: timing.sample_to_command,
            trip_ms: analysis.outages.iter().map(|outage| outage.trip_ms).collect(),
            restart_ms: analysis.outages.iter().map(|outage| outage.restart_ms).collect(),
            recording_bytes: analysis.trace.bytes,
            model_error: analysis.model.as_ref().map(|model| model.errors()).unwrap_or_default(),
            identify: None,
            closed_loop: None,
            identify_refused: None,
        }
    }

    /// With how the loop was closed, `hidden` in it the effect that was hidden.
    #[must_use]
    pub fn with_closed_loop(self, closed_loop: &ClosedLoop, hidden: Option<&str>) -> Self {
        Self { closed_loop: closed_loop.summary(hidden), ..self }
    }

    /// With what identify says of the recording.
    #[must_use]
    pub fn with_identify(self, identify_result: &IdentifyResult) -> Self {
        let identify_refused = match identify_result {
            IdentifyResult::Failed(reason) => Some(reason.clone()),
            _ => None,
        };
        Self { identify: identify_result.value(), identify_refused, ..self }
    }
}

/// The outcome of a run.
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome {
    /// All requirements were met.
    Kept,
    /// Messages that were published, or ticks that should have been acquired, are not on disk.
    DataLost(Vec<String>),
    /// A requirement was not met.
    Broken(Vec<String>),
}

impl Outcome {
    /// Judges one run. What happened after a recording broke off is not known: that counts as lost
    /// data, not as an unmet requirement.
    pub fn of(analysis: &Analysis) -> Self {
        let (mut broken, mut lost) = (Vec::new(), Vec::new());
        for outage in &analysis.outages {
            let process = outage.kill.process;
            let missing = [
                (outage.trip_ms, "the motor was not at 0 V until power was enabled again"),
                (outage.restart_ms, "no valid message of a successor"),
                (outage.powered_ms, "the motor did not get power again"),
            ];
            let missing: Vec<&str> =
                missing.iter().filter(|(at, _)| at.is_none()).map(|(_, what)| *what).collect();
            if missing.is_empty() {
            } else if analysis.recorded_after(&outage.kill) {
                broken.extend(missing.iter().map(|what| format!("{process} killed: {what}")));
            } else {
                lost.push(format!(
                    "{process} killed: the recording ends before it shows what followed"
                ));
            }
        }
        if !broken.is_empty() {
            return Self::Broken(broken);
        }
        let losses = &analysis.losses;
        for topic in losses.topics.iter().filter(|topic| topic.lost > 0) {
            lost.push(format!("{} messages of topic {} are not on disk", topic.lost, topic.topic));
        }
        if losses.samples_missed > 0 {
            lost.push(format!("{} ticks were never acquired", losses.samples_missed));
        }
        if !losses.sound {
            lost.push("the recording is damaged, or was not ended in good order".to_owned());
        }
        if lost.is_empty() { Self::Kept } else { Self::DataLost(lost) }
    }

    /// Adds a loss of data; an unmet requirement takes precedence.
    #[must_use]
    pub fn with_lost(self, reason: String) -> Self {
        match self {
            Self::Kept => Self::DataLost(vec![reason]),
            Self::DataLost(mut reasons) => {
                reasons.push(reason);
                Self::DataLost(reasons)
            }
            broken @ Self::Broken(_) => broken,
        }
    }

    /// 0, 3 or 1.
    pub fn exit_code(&self) -> i32 {
        match self {
            Self::Kept => 0,
            Self::DataLost(_) => 3,
            Self::Broken(_) => 1,
        }
    }

    /// The requirements that were not met, or the data lost.
    pub fn reasons(&self) -> &[String] {
        match self {
            Self::Kept => &[],
            Self::DataLost(reasons) | Self::Broken(reasons) => reasons,
        }
    }
}

//! Processors: how deep they sleep, what governs their frequency, whether some are isolated.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

use runtime::placement::list;
use runtime::{Verdict, own_processors, realtime};
use serde::Serialize;

use crate::bench::Bench;
use crate::outcome::Outcome;

const SYSTEM: &str = "/sys/devices/system/cpu";
/// How long the sleep states are watched while a rig's request for no latency is held.
const WATCHED_FOR: Duration = Duration::from_millis(300);
/// A processor that wakes within this loses no more than the lateness that a wake has anyway (µs).
const SHALLOW_US: u64 = 10;
/// Sleeping so deep costs a period of acquisition at 2 kHz (µs).
const PERIOD_US: u64 = 500;

/// What was found of sleep states.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct IdleStates {
    /// Longest exit latency of a state that is not disabled (µs); `None` where the kernel knows no
    /// sleep states.
    deepest_us: Option<u64>,
    /// Its name.
    name: String,
    /// Whether the request for a latency of 0 µs was taken.
    held: bool,
    /// How often states that take time to wake were entered while it was held.
    entered: u64,
}

/// A sleep state of one processor.
struct State {
    name: String,
    latency_us: u64,
    disabled: bool,
    usage: u64,
}

pub(crate) fn examine_idle_states(_bench: &mut Bench<'_>) -> anyhow::Result<Outcome> {
    let awake = realtime::stay_awake();
    let before = states();
    std::thread::sleep(WATCHED_FOR);
    let after = states();
    let usage = |states: &[State]| -> u64 {
        states.iter().filter(|state| state.latency_us > 0).map(|state| state.usage).sum()
    };
    let deepest = before.iter().filter(|it| !it.disabled).max_by_key(|it| it.latency_us);
    let found = IdleStates {
        deepest_us: deepest.map(|state| state.latency_us),
        name: deepest.map_or_else(String::new, |state| state.name.clone()),
        held: awake.is_some(),
        entered: usage(&after).saturating_sub(usage(&before)),
    };
    Ok(judge_idle_states(&found).measured(&found))
}

fn text(path: &Path) -> Option<String> {
    std::fs::read_to_string(path).ok().map(|text| text.trim().to_owned())
}

fn of_processor(number: usize, within: &str) -> PathBuf {
    Path::new(SYSTEM).join(format!("cpu{number}")).join(within)
}

/// The sleep states of all processors that this process may run on.
fn states() -> Vec<State> {
    let folders = own_processors().into_iter().flat_map(|number| {
        let entries = std::fs::read_dir(of_processor(number, "cpuidle"));
        entries.into_iter().flatten().flatten().map(|entry| entry.path())
    });
    let number = |folder: &Path, file: &str| text(&folder.join(file))?.parse::<u64>().ok();
    folders
        .filter_map(|folder| {
            Some(State {
                name: text(&folder.join("name"))?,
                latency_us: number(&folder, "latency")?,
                disabled: number(&folder, "disable")? != 0,
                usage: number(&folder, "usage")?,
            })
        })
        .collect()
}

fn judge_idle_states(found: &IdleStates) -> Outcome {
    let IdleStates { deepest_us, name, held, entered } = found;
    let Some(deepest_us) = deepest_us else {
        return Outcome::new(Verdict::Pass, "the kernel lets no processor sleep in a deep state");
    };
    let text = format!("deepest state {name}, {deepest_us} µs to wake");
    if *deepest_us <= SHALLOW_US {
        return Outcome::new(Verdict::Pass, text);
    }
    match (held, entered) {
        (true, 0) => Outcome::new(
            Verdict::Pass,
            format!("{text}; not entered while held awake, as a rig does"),
        ),
        (true, _) => {
            let text = format!("{text}; entered {entered} times although held awake");
            Outcome::new(Verdict::Warn, text)
                .remedy("boot with cpuidle.off=1 or processor.max_cstate=1 idle=poll")
        }
        (false, _) => {
            let verdict = if *deepest_us >= PERIOD_US { Verdict::Fail } else { Verdict::Warn };
            Outcome::new(verdict, format!("{text}; /dev/cpu_dma_latency is not open to this user"))
        }
    }
}

pub(crate) fn examine_governor(_bench: &mut Bench<'_>) -> anyhow::Result<Outcome> {
    let found: BTreeMap<usize, String> = own_processors()
        .into_iter()
        .filter_map(|number| {
            Some((number, text(&of_processor(number, "cpufreq/scaling_governor"))?))
        })
        .collect();
    Ok(judge_governor(&found).measured(&found))
}

fn judge_governor(governors: &BTreeMap<usize, String>) -> Outcome {
    if governors.is_empty() {
        return Outcome::new(Verdict::Pass, "the kernel does not change the frequency here");
    }
    let slow: Vec<String> = governors
        .iter()
        .filter(|(_, governor)| *governor != "performance")
        .map(|(number, governor)| format!("{number} {governor}"))
        .collect();
    if slow.is_empty() {
        return Outcome::new(Verdict::Pass, "performance on every processor");
    }
    Outcome::new(Verdict::Warn, format!("processor {}", slow.join(", ")))
}

/// What was found of isolation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Isolation {
    /// Processors that are on.
    online: Vec<usize>,
    /// Those that the kernel keeps other work off (`isolcpus=`).
    isolated: Vec<usize>,
    /// Those without a periodic tick while one task runs (`nohz_full=`).
    without_tick: Vec<usize>,
    /// Those on which this process may run.
    allowed: Vec<usize>,
}

pub(crate) fn examine_isolation(_bench: &mut Bench<'_>) -> anyhow::Result<Outcome> {
    let of = |file: &str| {
        let text = text(&Path::new(SYSTEM).join(file)).unwrap_or_default();
        list(&text).into_iter().collect::<Vec<usize>>()
    };
    let found = Isolation {
        online: of("online"),
        isolated: of("isolated"),
        without_tick: of("nohz_full"),
        allowed: own_processors(),
    };
    Ok(judge_isolation(&found).measured(&found))
}

fn judge_isolation(found: &Isolation) -> Outcome {
    let Isolation { online, isolated, without_tick, allowed } = found;
    let numbers = |of: &[usize]| {
        if of.is_empty() {
            return "none".to_owned();
        }
        of.iter().map(usize::to_string).collect::<Vec<_>>().join(",")
    };
    let text = format!(
        "isolated {}, without tick {}, of {} on line",
        numbers(isolated),
        numbers(without_tick),
        online.len()
    );
    if allowed.len().max(isolated.len()) < 2 {
        let text = format!("{text}; {} for the rig: its loops wait for each other", allowed.len());
        return Outcome::new(Verdict::Fail, text).remedy(
            "give the rig two processors or more (a container's cpuset, a larger machine)",
        );
    }
    if isolated.len() >= 2 {
        return Outcome::new(Verdict::Pass, text);
    }
    Outcome::new(Verdict::Warn, text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn deep_sleep_matters_where_it_cannot_be_held_off() {
        let verdict = |deepest_us, held, entered| {
            let found = IdleStates { deepest_us, name: "C6".to_owned(), held, entered };
            judge_idle_states(&found).verdict
        };
        assert_eq!(verdict(None, false, 0), Verdict::Pass);
        assert_eq!(verdict(Some(10), false, 100), Verdict::Pass);
        assert_eq!(verdict(Some(11), false, 100), Verdict::Warn);
        assert_eq!(verdict(Some(499), false, 100), Verdict::Warn);
        assert_eq!(verdict(Some(500), false, 100), Verdict::Fail);
        assert_eq!(verdict(Some(500), true, 0), Verdict::Pass);
        assert_eq!(verdict(Some(500), true, 1), Verdict::Warn);
    }

    #[test]
    fn every_governor_must_be_performance() {
        let of = |governors: &[(usize, &str)]| {
            let map = governors.iter().map(|(number, text)| (*number, (*text).to_owned()));
            judge_governor(&map.collect())
        };
        assert_eq!(of(&[]).verdict, Verdict::Pass);
        assert_eq!(of(&[(0, "performance"), (1, "performance")]).verdict, Verdict::Pass);
        let mixed = of(&[(0, "performance"), (1, "powersave")]);
        assert_eq!((mixed.verdict, mixed.value.as_str()), (Verdict::Warn, "processor 1 powersave"));
    }

    #[test]
    fn two_isolated_processors_pass_and_one_processor_fails() {
        let verdict = |allowed: &[usize], isolated: &[usize]| {
            judge_isolation(&Isolation {
                online: vec![0, 1, 2, 3],
                isolated: isolated.to_vec(),
                without_tick: Vec::new(),
                allowed: allowed.to_vec(),
            })
            .verdict
        };
        assert_eq!(verdict(&[0, 1], &[2, 3]), Verdict::Pass);
        assert_eq!(verdict(&[0, 1, 2], &[3]), Verdict::Warn);
        assert_eq!(verdict(&[0, 1], &[]), Verdict::Warn);
        assert_eq!(verdict(&[0], &[]), Verdict::Fail);
        assert_eq!(verdict(&[0], &[2, 3]), Verdict::Pass);
    }
}

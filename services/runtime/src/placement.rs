//! Which processor each loop of a rig runs on: chosen by the keeper at the cold start, kept in the
//! session, applied by each process to its own loop, whoever has started it.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use ipc_types::Process;

use crate::bare_loop::own_processors;

/// Environment variable by which a person turns the placement `on` or `off`.
pub const PLACEMENT_VARIABLE: &str = "FARREACH_PLACEMENT";
/// How long the load of the processors is observed.
const OBSERVED_FOR: Duration = Duration::from_millis(300);
/// The loops, those first that shall have a processor of their own. The simulated card comes last:
/// what the others get does not depend on whether there is one.
const LOOPS: [Process; 5] = [
    Process::Acquisition,
    Process::Control,
    Process::Watchdog,
    Process::Experiment,
    Process::Simulator,
];

/// Whether a person has turned the placement on.
pub fn placement_is_on() -> bool {
    std::env::var(PLACEMENT_VARIABLE).is_ok_and(|value| value == "on")
}

/// The loops of a rig with their rates (Hz), in the order in which they are placed.
pub fn loops() -> Vec<(Process, u32)> {
    LOOPS.into_iter().filter_map(|process| Some((process, process.real_time()?.rate_hz))).collect()
}

/// A processor of this machine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Processor {
    /// Its number.
    pub number: usize,
    /// Whether the kernel keeps other work off it (`isolcpus=`).
    pub isolated: bool,
    /// Share of its time that it is busy with other work, 0 to 1.
    pub load: f64,
}

/// Places loops on processors. Isolated processors are taken alone where there are two or more,
/// otherwise before the others; then those with the least load. The first two loops never share a
/// processor where there are two. Each further one goes where the fewest cycles per second run
/// already; ties go to the processor that is preferred. Empty without processors.
pub fn place(processors: &[Processor], loops: &[(Process, u32)]) -> BTreeMap<Process, usize> {
    let mut preferred = processors.to_vec();
    preferred.sort_by(|a, b| {
        let by_load = a.load.total_cmp(&b.load);
        b.isolated.cmp(&a.isolated).then(by_load).then(a.number.cmp(&b.number))
    });
    let isolated = preferred.iter().filter(|processor| processor.isolated).count();
    if isolated >= 2 {
        preferred.truncate(isolated);
    }
    let mut cycles = vec![0_u64; preferred.len()];
    let mut placed = BTreeMap::new();
    for (process, rate_hz) in loops {
        // The first of those with the least.
        let Some(least) = (0..cycles.len()).min_by_key(|&at| cycles[at]) else { break };
        cycles[least] += u64::from(*rate_hz);
        placed.insert(*process, preferred[least].number);
    }
    placed
}

/// The processors that the loops may have, with their load over 0.3 s: those that this process may
/// run on, and those that are isolated. Blocks meanwhile.
pub fn observe_processors() -> Vec<Processor> {
    let system = |file: &str| {
        std::fs::read_to_string(format!("/sys/devices/system/cpu/{file}")).unwrap_or_default()
    };
    let times = || busy_and_all(&std::fs::read_to_string("/proc/stat").unwrap_or_default());
    let before = times();
    std::thread::sleep(OBSERVED_FOR);
    let after = times();
    let (isolated, online) = (list(&system("isolated")), list(&system("online")));
    let own: BTreeSet<usize> = own_processors().into_iter().collect();
    own.union(&isolated)
        .filter(|&number| online.is_empty() || online.contains(number))
        .map(|&number| Processor {
            number,
            isolated: isolated.contains(&number),
            load: load(before.get(&number), after.get(&number)),
        })
        .collect()
}

/// Numbers in a list of the kernel's: `0-3,8`.
pub fn list(text: &str) -> BTreeSet<usize> {
    let range = |part: &str| {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        Some(first.trim().parse::<usize>().ok()?..=last.trim().parse().ok()?)
    };
    text.trim().split(',').filter_map(range).flatten().collect()
}

/// Busy and total time of each processor since boot (ticks), from the text of `/proc/stat`.
fn busy_and_all(stat: &str) -> BTreeMap<usize, (u64, u64)> {
    let processor = |line: &str| {
        let (number, times) = line.strip_prefix("cpu")?.split_once(' ')?;
        let times: Vec<u64> =
            times.split_whitespace().take(8).map(str::parse).collect::<Result<_, _>>().ok()?;
        let all: u64 = times.iter().sum();
        // idle and iowait
        let idle = times.get(3)? + times.get(4)?;
        Some((number.parse().ok()?, (all - idle, all)))
    };
    stat.lines().filter_map(processor).collect()
}

fn load(before: Option<&(u64, u64)>, after: Option<&(u64, u64)>) -> f64 {
    let (Some(before), Some(after)) = (before, after) else { return 0.0 };
    let all = after.1.saturating_sub(before.1);
    if all == 0 { 0.0 } else { after.0.saturating_sub(before.0) as f64 / all as f64 }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn processor(number: usize, isolated: bool, load: f64) -> Processor {
        Processor { number, isolated, load }
    }

    fn numbers(processors: &[Processor]) -> Vec<usize> {
        let placed = place(processors, &loops());
        LOOPS.iter().filter_map(|process| placed.get(process).copied()).collect()
    }

    #[test]
    fn on_two_processors_acquisition_and_control_have_one_each() {
        let two = [processor(0, false, 0.4), processor(1, false, 0.1)];
        // acquisition 2000 on 1; control 500, watchdog 1000, experiment 500, then the card on 0:
        // 2000 on both when the card is placed
        assert_eq!(numbers(&two), [1, 0, 0, 0, 1]);
    }

    #[test]
    fn isolated_processors_are_taken_alone_where_there_are_two() {
        let some = [
            processor(0, false, 0.0),
            processor(1, false, 0.0),
            processor(2, true, 0.5),
            processor(3, true, 0.0),
        ];
        assert_eq!(numbers(&some), [3, 2, 2, 2, 3]);
        let one = [processor(0, false, 0.0), processor(1, false, 0.2), processor(2, true, 0.9)];
        assert_eq!(numbers(&one), [2, 0, 1, 0, 0]);
    }

    #[test]
    fn with_enough_processors_each_loop_has_one_and_the_busiest_is_left() {
        let six: Vec<_> =
            (0..6).map(|at| processor(at, false, if at == 2 { 0.9 } else { 0.1 })).collect();
        assert_eq!(numbers(&six), [0, 1, 3, 4, 5]);
    }

    #[test]
    fn one_processor_takes_all_and_none_takes_nothing() {
        assert_eq!(numbers(&[processor(0, false, 1.0)]), [0; 5]);
        assert!(place(&[], &loops()).is_empty());
    }

    #[test]
    fn lists_and_times_of_the_kernel() {
        assert_eq!(list("0-3,8\n"), BTreeSet::from([0, 1, 2, 3, 8]));
        assert!(list("\n").is_empty());
        let stat = "cpu  1 2 3 4 5 6 7 8 0 0\ncpu0 10 0 10 70 10 0 0 0 0 0\nintr 5\n";
        assert_eq!(busy_and_all(stat), BTreeMap::from([(0, (20, 100))]));
        assert!((load(Some(&(20, 100)), Some(&(70, 200))) - 0.5).abs() < 1e-12);
        assert_eq!(load(None, Some(&(1, 1))), 0.0);
    }

    #[test]
    fn this_machine_has_a_processor() {
        let found = observe_processors();
        assert!(!found.is_empty());
        assert!(found.iter().all(|processor| (0.0..=1.0).contains(&processor.load)), "{found:?}");
    }

    proptest! {
        #[test]
        fn every_loop_is_placed_and_the_first_two_apart(
            loads in prop::collection::vec((any::<bool>(), 0.0..1.0_f64), 1..9),
        ) {
            let processors: Vec<_> = loads
                .iter()
                .enumerate()
                .map(|(number, (isolated, load))| processor(number, *isolated, *load))
                .collect();
            let placed = place(&processors, &loops());
            prop_assert_eq!(placed.len(), LOOPS.len());
            prop_assert!(placed.values().all(|number| *number < processors.len()));
            if processors.len() >= 2 {
                prop_assert_ne!(placed[&Process::Acquisition], placed[&Process::Control]);
            }
            let isolated = processors.iter().filter(|it| it.isolated).count();
            if isolated >= 2 {
                prop_assert!(placed.values().all(|number| processors[*number].isolated));
            }
        }
    }
}

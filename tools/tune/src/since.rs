//! Is the machine still the one that was tuned? The monitor's observers run along the excitation of
//! an earlier tuning, from which they learn their baseline, and then along that of today.

use std::path::Path;

use anyhow::Context as _;
use ipc_types::{SAMPLE, Sample};
use monitor::axis_monitor::{AxisMonitor, BLOCK_ROWS, LEARNING_BLOCKS, Seen};
use monitor::departure::Verdict;
use recording::mcap_read::Recording;
use rig::RigFile;
use serde::Serialize;

/// Rows of the monitor in a second.
const ROWS_HZ: f64 = 250.0;

/// What the comparison shows.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case", tag = "machine")]
pub enum Since {
    /// It moves as it did.
    Same {
        /// Movement of today that was compared (s).
        compared_s: f64,
        /// Largest cumulative sum, which is 1 at an alarm.
        largest_sum: f64,
    },
    /// It does not.
    Changed {
        /// Movement until this was clear (s).
        after_s: f64,
        /// The effect that explains most of it, `ID@SITE` or the name of a parameter.
        likely: Option<String>,
        /// Where.
        site: Option<String>,
    },
    /// The earlier recording is too short for a baseline.
    Unknown {
        /// Movement in it (s).
        found_s: f64,
        /// Movement that is needed (s).
        needed_s: f64,
    },
}

fn seconds(blocks: u32) -> f64 {
    f64::from(blocks) * f64::from(BLOCK_ROWS) / ROWS_HZ
}

/// Compares two series of samples of the first axis of a rig.
///
/// # Errors
/// Where the declared model cannot be simulated, or a sample cannot be read.
pub fn compare(
    rig: &RigFile,
    then: impl Iterator<Item = anyhow::Result<Sample>>,
    now: impl Iterator<Item = anyhow::Result<Sample>>,
) -> anyhow::Result<Since> {
    let axis = rig.axes.first().context("the rig has no axis")?;
    let mut monitor = AxisMonitor::new(rig, 0, axis)?;
    let mut blocks = 0;
    for sample in then {
        // A departure within the baseline's own recording is no change since then.
        blocks += u32::from(matches!(monitor.see(&sample?, 0.0), Seen::Block(..)));
    }
    if monitor.baseline().is_none() {
        let needed_s = seconds(LEARNING_BLOCKS as u32);
        return Ok(Since::Unknown { found_s: seconds(blocks), needed_s });
    }
    let (mut compared, mut changed, mut largest) = (0, None, 0.0_f64);
    for sample in now {
        let Seen::Block(_, verdict) = monitor.see(&sample?, 0.0) else { continue };
        compared += 1;
        let sums = monitor.detector().sums();
        largest = sums.into_iter().fold(largest, f64::max);
        if verdict == Verdict::Departs {
            changed.get_or_insert(compared);
        }
    }
    let Some(after) = changed else {
        let largest_sum = largest / ipc_types::MODEL_DEPARTURE_SUM;
        return Ok(Since::Same { compared_s: seconds(compared), largest_sum });
    };
    let origin = monitor.origin();
    Ok(Since::Changed {
        after_s: seconds(after),
        likely: origin.map(|origin| format!("{}@{}", origin.id, origin.site.name())),
        site: origin.map(|origin| origin.site.name().to_owned()),
    })
}

/// Compares two recordings of the same excitation.
///
/// # Errors
/// As [`compare`], with the file.
pub fn compare_recordings(rig: &RigFile, then: &Path, now: &Path) -> anyhow::Result<Since> {
    let (before, today) = (Recording::open(then)?, Recording::open(now)?);
    fn samples<'r>(
        recording: &'r Recording,
    ) -> anyhow::Result<impl Iterator<Item = anyhow::Result<Sample>> + 'r> {
        let messages = recording.messages::<Sample>(SAMPLE.topic.name)?;
        Ok(messages.map(|message| Ok(message?.message)))
    }
    compare(rig, samples(&before)?, samples(&today)?)
}

impl Since {
    /// In a sentence.
    pub fn sentence(&self) -> String {
        match self {
            Self::Same { compared_s, largest_sum } => format!(
                "the machine moves as it did when it was tuned ({compared_s:.0} s of movement \
                 compared; the largest cumulative sum was {:.0} % of an alarm's)",
                100.0 * largest_sum
            ),
            Self::Changed { after_s, likely, .. } => format!(
                "THE MACHINE IS NOT THE ONE THAT WAS TUNED: clear after {after_s:.1} s of \
                 movement{}",
                match likely {
                    Some(likely) => format!(", most like {likely}"),
                    None => String::new(),
                }
            ),
            Self::Unknown { found_s, needed_s } => format!(
                "whether it is the machine that was tuned is not known: expected {needed_s:.0} s \
                 of movement in the earlier excitation, found {found_s:.0} s"
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use rig::load_protocol;

    use super::*;
    use crate::simulated::{Machine, samples};

    fn excitation(rig: &RigFile, seed: u64, effects: &[&str], length_s: u32) -> Vec<Sample> {
        let set = |part: &str| format!("segments.{part}");
        let shorter = [
            set(&format!("0.duration_s={length_s}")),
            set("1.duration_s=4"),
            set("2.duration_s=4"),
        ];
        let protocol = load_protocol("tuning-excitation".as_ref(), &shorter).unwrap();
        let mut rig = rig.clone();
        rig.simulation.seed = seed;
        let effects: Vec<String> = effects.iter().map(|effect| (*effect).to_owned()).collect();
        samples(&rig, Machine { rig: &rig, effects: &effects }, &protocol).unwrap()
    }

    #[test]
    fn a_machine_is_compared_with_itself_and_with_one_that_has_worn() {
        let rig = rig::load_rig("hydrostatic".as_ref()).unwrap();
        let of =
            |samples: &[Sample]| samples.iter().copied().map(Ok).collect::<Vec<_>>().into_iter();
        let then = excitation(&rig, 1, &[], 16);
        let same = excitation(&rig, 2, &[], 16);
        let since = compare(&rig, of(&then), of(&same)).unwrap();
        let Since::Same { compared_s, largest_sum } = since else { panic!("{since:?}") };
        assert!(compared_s > 20.0 && largest_sum < 0.5, "{compared_s} {largest_sum}");
        let worn = excitation(&rig, 3, &["backlash@slave=0.04"], 16);
        let since = compare(&rig, of(&then), of(&worn)).unwrap();
        let Since::Changed { likely, site, .. } = &since else { panic!("{since:?}") };
        assert_eq!((likely.as_deref(), site.as_deref()), (Some("backlash@slave"), Some("slave")));
        assert!(since.sentence().contains("NOT THE ONE"), "{}", since.sentence());
    }

    #[test]
    fn a_baseline_that_is_too_short_is_said() {
        let rig = rig::load_rig("hydrostatic".as_ref()).unwrap();
        let short = excitation(&rig, 1, &[], 4);
        let of =
            |samples: &[Sample]| samples.iter().copied().map(Ok).collect::<Vec<_>>().into_iter();
        let since = compare(&rig, of(&short), of(&short)).unwrap();
        let Since::Unknown { found_s, needed_s } = since else { panic!("{since:?}") };
        assert!(found_s > 8.0 && found_s < needed_s && needed_s == 20.0, "{found_s} {needed_s}");
    }
}

//! Messages that were published and are not on disk, and ticks that were never acquired.

use ipc_types::SAMPLE;

use super::recorded_messages::{Trace, by_tick};

/// One topic.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TopicLoss {
    /// Its name.
    pub topic: String,
    /// Messages on disk.
    pub written: u64,
    /// Messages published that are not.
    pub lost: u64,
}

/// Missing messages and ticks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Losses {
    /// Samples on disk.
    pub samples: u64,
    /// Samples published that are not on disk.
    pub samples_lost: u64,
    /// Ticks of the grid, from the first sample to the last, that acquisition never published.
    pub samples_missed: u64,
    /// Every topic with messages or losses.
    pub topics: Vec<TopicLoss>,
    /// Whether the file ended cleanly and is undamaged.
    pub sound: bool,
}

impl Losses {
    /// Whether anything is missing, of any topic.
    pub fn any(&self) -> bool {
        !self.sound || self.samples_missed > 0 || self.topics.iter().any(|topic| topic.lost > 0)
    }
}

/// Counts what is missing.
///
/// A message that the logger dropped is a gap in the file as well, unless it was the last of its
/// sender. So the larger of the two counts is taken: gaps in the file, and what the logger counted.
/// The first incarnation of acquisition was recorded from its first sample on, so that a first
/// sequence above 0 is a loss, too.
pub fn losses(trace: &Trace) -> Losses {
    let counted = |topic: &str| {
        trace.counted.iter().find(|(name, _)| name == topic).map_or(0, |(_, lost)| *lost)
    };
    let head = trace.samples.first().map_or(0, |sample| sample.sequence);
    let mut topics = Vec::new();
    for check in &trace.check.topics {
        let first = if check.topic == SAMPLE.topic.name { head } else { 0 };
        let lost = (first + check.gaps + check.undecodable).max(counted(&check.topic));
        if check.count > 0 || lost > 0 {
            topics.push(TopicLoss { topic: check.topic.clone(), written: check.count, lost });
        }
    }
    let samples_lost = topics.iter().find(|t| t.topic == SAMPLE.topic.name).map_or(0, |t| t.lost);
    Losses {
        samples: trace.samples.len() as u64,
        samples_lost,
        samples_missed: missed(trace),
        topics,
        sound: trace.check.complete && trace.check.ended_cleanly && trace.check.damage.is_empty(),
    }
}

/// Holes in the ticks less the samples that were acquired and lost on their way: those leave a gap
/// in the sequence.
fn missed(trace: &Trace) -> u64 {
    let ticks = by_tick(&trace.samples);
    let (Some(first), Some(last)) = (ticks.first(), ticks.last()) else { return 0 };
    let holes = last.tick - first.tick + 1 - ticks.len() as u64;
    let check = trace.check.topics.iter().find(|check| check.topic == SAMPLE.topic.name);
    holes.saturating_sub(check.map_or(0, |check| check.gaps))
}

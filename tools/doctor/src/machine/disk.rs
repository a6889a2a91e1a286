//! The disk of the recordings: sustained write, and how long a sync holds the writer up.

use std::io::Write as _;
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use ipc_types::{Rate, TOPICS, Topic};
use logger::{QUEUE_BYTES, QUEUE_HEADER_BYTES};
use runtime::Verdict;
use rustix::fs::fdatasync;
use serde::Serialize;

use crate::bench::Bench;
use crate::outcome::Outcome;

/// A measurement ends after this time, or ...
const MEASURED_FOR: Duration = Duration::from_secs(2);
/// ... after so many bytes: a disk that is so quick needs no longer.
const MOST_BYTES: u64 = 256 << 20;
const BLOCK: usize = 1 << 20;
/// A sync is due so often while a recording runs, as in the writer of the recordings
/// (`recording::mcap_write::SYNC_NS`); here more often, to see more of them.
const SYNC_EVERY: Duration = Duration::from_millis(100);
/// A disk this many times as fast as a recording passes: exports and other programs use it, too.
const COMFORT: f64 = 10.0;
/// Below this it cannot keep up while something else writes.
const NEED: f64 = 2.0;
/// Bytes that MCAP adds to a message: opcode, length, channel, sequence, two times (31), and the
/// CDR header (4).
const AROUND_A_MESSAGE: usize = 35;

/// What a rig publishes: messages per second, and bytes per second with so many more for each.
fn published(around_a_message: usize) -> (f64, f64) {
    let rate = |topic: &Topic| match topic.rate {
        Rate::Loop(process) => process.real_time().map_or(0.0, |of| f64::from(of.rate_hz)),
        Rate::Hertz(hertz) => f64::from(hertz),
        Rate::Sporadic => 0.0,
    };
    TOPICS.iter().fold((0.0, 0.0), |(messages, bytes), topic| {
        let rate = rate(topic);
        (messages + rate, bytes + rate * (topic.size + around_a_message) as f64)
    })
}

/// What was found of sustained writing.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Sustained {
    /// Rate, the final sync included (bytes/s).
    bytes_per_s: f64,
    /// What a recording writes before compression (bytes/s).
    needed_bytes_per_s: f64,
}

pub(crate) fn examine_write(bench: &mut Bench<'_>) -> anyhow::Result<Outcome> {
    let bytes_per_s = sustained(bench.folder())?;
    let found = Sustained { bytes_per_s, needed_bytes_per_s: published(AROUND_A_MESSAGE).1 };
    Ok(judge_write(found).measured(&found))
}

fn new_file(folder: &Path) -> anyhow::Result<tempfile::NamedTempFile> {
    tempfile::Builder::new()
        .prefix(".farreach-doctor-")
        .tempfile_in(folder)
        .with_context(|| format!("{}: expected a folder to write to", folder.display()))
}

fn sustained(folder: &Path) -> anyhow::Result<f64> {
    let mut file = new_file(folder)?;
    // Not all the same: some disks compress.
    let block: Vec<u8> = (0..BLOCK).map(|at| ((at * at) >> 7) as u8).collect();
    let begun = Instant::now();
    let mut bytes = 0;
    while begun.elapsed() < MEASURED_FOR && bytes < MOST_BYTES {
        file.write_all(&block).context("write")?;
        bytes += BLOCK as u64;
    }
    fdatasync(file.as_file()).context("sync")?;
    Ok(bytes as f64 / begun.elapsed().as_secs_f64())
}

fn judge_write(found: Sustained) -> Outcome {
    let Sustained { bytes_per_s, needed_bytes_per_s } = found;
    let times = bytes_per_s / needed_bytes_per_s;
    let verdict = match times {
        COMFORT.. => Verdict::Pass,
        NEED..COMFORT => Verdict::Warn,
        _ => Verdict::Fail,
    };
    let (found, needed) = (bytes_per_s * 1e-6, needed_bytes_per_s * 1e-6);
    let text = format!("{found:.0} MB/s; a recording writes at most {needed:.1} MB/s");
    Outcome::new(verdict, text)
}

/// What was found of syncs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Syncs {
    /// Syncs made.
    count: u64,
    /// The longest (s).
    longest_s: f64,
    /// What the logger's queue holds at the highest rate (s).
    queue_s: f64,
}

pub(crate) fn examine_sync(bench: &mut Bench<'_>) -> anyhow::Result<Outcome> {
    let (_, bytes_per_s) = published(AROUND_A_MESSAGE);
    let part = (bytes_per_s * SYNC_EVERY.as_secs_f64()) as usize;
    let (count, longest_s) = syncs(bench.folder(), part)?;
    let found = Syncs { count, longest_s, queue_s: queue_s() };
    Ok(judge_sync(found).measured(&found))
}

/// How long the logger's queue takes in everything while the disk stands still (s).
fn queue_s() -> f64 {
    QUEUE_BYTES as f64 / published(QUEUE_HEADER_BYTES).1
}

/// Writes and syncs at a recording's rate.
fn syncs(folder: &Path, part: usize) -> anyhow::Result<(u64, f64)> {
    let mut file = new_file(folder)?;
    let block: Vec<u8> = (0..part).map(|at| ((at * at) >> 7) as u8).collect();
    let begun = Instant::now();
    let (mut count, mut longest_s) = (0, 0.0_f64);
    while begun.elapsed() < MEASURED_FOR {
        let writing = Instant::now();
        file.write_all(&block).context("write")?;
        fdatasync(file.as_file()).context("sync")?;
        longest_s = longest_s.max(writing.elapsed().as_secs_f64());
        count += 1;
        std::thread::sleep(SYNC_EVERY.saturating_sub(writing.elapsed()));
    }
    Ok((count, longest_s))
}

/// A sync that takes longer than the queue holds costs messages; two seconds do not show the
/// longest, so that a quarter of it must do.
fn judge_sync(found: Syncs) -> Outcome {
    let Syncs { count, longest_s, queue_s } = found;
    let verdict = crate::outcome::at_most(longest_s, queue_s / 4.0, queue_s / 2.0);
    let text = format!(
        "longest of {count} syncs {:.1} ms; the logger's queue holds {queue_s:.1} s",
        longest_s * 1e3
    );
    Outcome::new(verdict, text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ten_times_a_recording_passes_and_twice_is_needed() {
        let verdict = |times: f64| {
            let found = Sustained { bytes_per_s: times * 1e6, needed_bytes_per_s: 1e6 };
            judge_write(found).verdict
        };
        assert_eq!(verdict(10.0), Verdict::Pass);
        assert_eq!(verdict(9.99), Verdict::Warn);
        assert_eq!(verdict(2.0), Verdict::Warn);
        assert_eq!(verdict(1.99), Verdict::Fail);
        assert_eq!(verdict(f64::NAN), Verdict::Fail);
    }

    #[test]
    fn a_sync_must_end_before_the_queue_is_full() {
        let verdict = |longest_s| judge_sync(Syncs { count: 20, longest_s, queue_s: 4.0 }).verdict;
        assert_eq!(verdict(1.0), Verdict::Pass);
        assert_eq!(verdict(1.01), Verdict::Warn);
        assert_eq!(verdict(2.0), Verdict::Warn);
        assert_eq!(verdict(2.01), Verdict::Fail);
    }

    #[test]
    fn the_rate_of_a_recording_follows_from_the_table_of_topics() {
        let (messages, bytes) = published(AROUND_A_MESSAGE);
        // Sample, scan and output at 2 kHz, token and line at 1 kHz, command and setpoint at
        // 500 Hz, and some slow ones.
        assert!((9000.0..9500.0).contains(&messages), "{messages}");
        assert!((1e6..2e7).contains(&bytes), "{bytes}");
        // "About four seconds", says the queue.
        assert!((3.5..5.0).contains(&queue_s()), "{}", queue_s());
    }

    #[test]
    fn a_folder_that_is_not_there_is_an_error() {
        let error = sustained(Path::new("/nowhere/at/all")).unwrap_err().to_string();
        assert!(error.contains("/nowhere/at/all: expected a folder to write to"), "{error}");
    }
}

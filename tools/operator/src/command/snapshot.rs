//! `rec snapshot`: what a ring holds, in a file.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::ErrorKind;
use std::os::fd::AsRawFd;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use clap::{Args, ValueEnum};
use ipc_types::{EnableToken, LoggerAnswer, LoggerRequest, RingStatus, TOKEN, WatchdogState};
use recorder::{Copied, Part};
use runtime::clock::{SECOND_NS, now_ns};
use runtime::{RequestError, RigName};
use serde_json::json;

use super::actions::link;
use super::split::nanoseconds;
use super::{OutputFormat, print};
use crate::{DATA_LOST, DONE, Error, RigLink};

/// How often the parts of the ring are taken hold of: more often than any is removed.
const HOLD: Duration = Duration::from_millis(300);
/// How long a logger may be away, whose death may be what the snapshot is of.
const AWAY: Duration = Duration::from_secs(30);
/// How often the watchdog's tokens are looked at.
const LOOK: Duration = Duration::from_millis(10);

/// `farreach rec snapshot`.
#[derive(Clone, Debug, Args)]
pub struct SnapshotArguments {
    /// MCAP file to create; it must not exist
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// How much of the past goes into it; the whole ring, if left out
    #[arg(long, value_name = "TIME", value_parser = humantime::parse_duration)]
    pub before: Option<Duration>,
    /// How much of the future goes into it: the command waits for it
    #[arg(long, value_name = "TIME", default_value = "0s",
        value_parser = humantime::parse_duration)]
    pub after: Duration,
    /// Waits until this happens; now, if left out
    #[arg(long, value_enum)]
    pub on: Option<Trigger>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub json: OutputFormat,
}

/// What a snapshot waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Trigger {
    /// The watchdog cuts the motor's power, or finds a fault.
    Trip,
}

/// Parts of a ring, held open: they are there although the logger removes their names.
#[derive(Debug, Default)]
struct Held(BTreeMap<u32, (PathBuf, File)>);

impl Held {
    fn take_hold(&mut self, ring: &RingStatus) -> anyhow::Result<()> {
        for number in &ring.parts {
            if self.0.contains_key(number) {
                continue;
            }
            let path = recording::part_path(Path::new(&ring.first), *number);
            match File::open(&path) {
                Ok(file) => {
                    self.0.insert(*number, (path, file));
                }
                // The oldest may be gone by now.
                Err(error) if error.kind() == ErrorKind::NotFound => {}
                Err(error) => {
                    return Err(error).with_context(|| format!("{}: cannot read", path.display()));
                }
            }
        }
        Ok(())
    }

    /// Those before the present one.
    fn ended(&self, ring: &RingStatus) -> Vec<Part> {
        let present = ring.parts.last().copied().unwrap_or(0);
        let ended = self.0.range(..present);
        let part = |(_, (name, file)): (&u32, &(PathBuf, File))| Part {
            name: name.clone(),
            at: PathBuf::from(format!("/proc/self/fd/{}", file.as_raw_fd())),
        };
        ended.map(part).collect()
    }
}

/// Writes a snapshot, and prints what is in it. The exit code says whether messages are missing.
///
/// # Errors
/// Where there is no ring, or the file cannot be written.
pub(super) fn snapshot(rig_name: &RigName, arguments: &SnapshotArguments) -> anyhow::Result<i32> {
    let SnapshotArguments { file, before, after, on, json: OutputFormat { json } } = arguments;
    check_creatable(file)?;
    let link = link(rig_name)?;
    let length = Duration::from_nanos(patient(|| ring(&link))?.keep_ns);
    let before = before.unwrap_or(length);
    check_times(before, *after, length)?;
    let at_ns = match on {
        None => now_ns(),
        Some(Trigger::Trip) => trip(&link)?,
    };
    let mut held = Held::default();
    held.take_hold(&patient(|| ring(&link))?)?;
    let [before_ns, after_ns] = [before, *after].map(nanoseconds);
    let until_ns = at_ns.saturating_add(after_ns);
    while let Some(left_ns) = until_ns.checked_sub(now_ns()).filter(|left| *left > 0) {
        std::thread::sleep(HOLD.min(Duration::from_nanos(left_ns)));
        // A logger that is away is back by the next time, or does not answer in the end.
        if let Ok(ring) = ring(&link) {
            held.take_hold(&ring)?;
        }
    }
    // The parts up to there are whole then.
    let LoggerAnswer { ring, error, .. } = patient(|| link.logger(&LoggerRequest::NextPart))?;
    let Some(ring) = ring else { return Err(Error::Logger(error).into()) };
    // Where its disk failed, what is there is still worth having.
    if !error.is_empty() {
        eprintln!("farreach: {error}");
    }
    held.take_hold(&ring)?;
    let times_ns = at_ns.saturating_sub(before_ns)..until_ns;
    let cause = on.map_or("command", |Trigger::Trip| "trip");
    let notes = [("trigger", cause.to_owned()), ("trigger_ns", at_ns.to_string())];
    let notes = notes.map(|(key, value)| (key.to_owned(), value)).into();
    let Copied { messages, times_ns: found, lost } =
        recorder::copy_interval(&held.ended(&ring), times_ns, notes, file)?;
    let lost = lost || !error.is_empty();
    let [before_s, after_s] = [at_ns as f64 - found.start as f64, found.end as f64 - at_ns as f64]
        .map(|ns| ns / SECOND_NS as f64);
    let value = json!({
        "file": file,
        "messages": messages,
        "before_s": before_s,
        "after_s": after_s,
        "trigger": cause,
        "trigger_ns": at_ns,
        "data_lost": lost,
    });
    let text = format!(
        "{}: {messages} messages, from {before_s:.3} s before to {after_s:.3} s after",
        file.display()
    );
    print(*json, value, &text)?;
    if lost {
        eprintln!("farreach: messages are missing in it: `rec verify` tells which");
    }
    Ok(if lost { DATA_LOST } else { DONE })
}

/// Refuses a file that is there, or cannot be created: before anything is waited for.
fn check_creatable(file: &Path) -> anyhow::Result<()> {
    if file.symlink_metadata().is_ok() {
        bail!("{}: it is there already; recordings are never overwritten", file.display());
    }
    let tried = files::written(file, b"");
    tried.map(drop).with_context(|| format!("{}: cannot create", file.display()))
}

/// Refuses more than the ring keeps. Parts that are held take space although the ring has removed
/// them, and whoever set its length counted on that.
fn check_times(before: Duration, after: Duration, length: Duration) -> anyhow::Result<()> {
    if before > length {
        bail!("--before {before:?}: expected at most {length:?}, which is what the ring keeps");
    }
    if after > length {
        bail!("--after {after:?}: expected at most {length:?}, the length of the ring");
    }
    Ok(())
}

fn no_ring() -> Error {
    let text = "there is no ring (farreach rec start --ring 30s FILE); of a recording, `rec cut`";
    Error::Logger(text.to_owned())
}

fn ring(link: &RigLink) -> Result<RingStatus, Error> {
    link.logger(&LoggerRequest::Status)?.ring.ok_or_else(no_ring)
}

/// Asks again while the logger is away.
fn patient<T>(ask: impl Fn() -> Result<T, Error>) -> Result<T, Error> {
    let began = Instant::now();
    loop {
        match ask() {
            Err(Error::Request(error)) if may_pass(&error) && began.elapsed() < AWAY => {
                std::thread::sleep(HOLD);
            }
            answer => return answer,
        }
    }
}

/// Whether another attempt may have an answer.
fn may_pass(error: &RequestError) -> bool {
    !matches!(error, RequestError::TooLong { .. } | RequestError::Codec { .. })
}

/// Waits for a trip; returns when it was [ns, CLOCK_MONOTONIC].
fn trip(link: &RigLink) -> Result<u64, Error> {
    eprintln!("farreach: waiting for a trip; Ctrl-C ends it");
    let mut tokens = link.subscriber::<EnableToken>(TOKEN)?;
    let mut trips = Trips::default();
    let mut looked = Instant::now();
    loop {
        while let Some(token) = tokens.take()? {
            if trips.see(&token) {
                return Ok(token.time_ns);
            }
        }
        // Nothing comes of a session that is over, and no error either.
        if looked.elapsed() > HOLD {
            looked = Instant::now();
            let domain = link.domain();
            if !domain.is_current() {
                return Err(Error::NotUp(domain.name().to_string()));
            }
        }
        std::thread::sleep(LOOK);
    }
}

/// Notices that the watchdog takes power or readiness away.
#[derive(Debug, Default)]
struct Trips {
    was_sound: bool,
}

impl Trips {
    /// Whether this token is the first one of a trip; one that was there before is none.
    fn see(&mut self, token: &EnableToken) -> bool {
        let state = WatchdogState::from_code(token.state);
        let off = matches!(state, Some(WatchdogState::Tripped | WatchdogState::Faulted));
        let tripped = off && self.was_sound;
        self.was_sound = !off;
        tripped
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;

    #[test]
    fn a_trip_is_noticed_once_and_not_where_it_was_before() {
        use WatchdogState::{Armed, Disarmed, Enabled, Faulted, Tripped};
        let mut trips = Trips::default();
        let seen: Vec<bool> =
            [Faulted, Faulted, Disarmed, Armed, Enabled, Tripped, Tripped, Disarmed, Faulted]
                .into_iter()
                .map(|state| trips.see(&EnableToken { state: state.code(), ..Default::default() }))
                .collect();
        let expected = [false, false, false, false, false, true, false, false, true];
        assert_eq!(seen, expected);
    }

    #[test]
    fn a_file_that_cannot_be_created_is_told_before_anything_is_waited_for() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("trip.mcap");
        check_creatable(&path).unwrap();
        assert_eq!(folder.path().read_dir().unwrap().count(), 0, "nothing is left of the attempt");
        let absent = folder.path().join("absent").join("trip.mcap");
        let error = format!("{:#}", check_creatable(&absent).unwrap_err());
        assert!(error.contains("absent/trip.mcap: cannot create: "), "{error}");
        std::fs::write(&path, "somebody's").unwrap();
        let error = check_creatable(&path).unwrap_err().to_string();
        assert!(error.contains("never overwritten"), "{error}");
    }

    #[test]
    fn a_logger_that_is_away_is_asked_again_and_one_that_refuses_is_not() {
        let asked = Cell::new(0);
        let ask = |away: u32, error: fn() -> Error| {
            asked.set(0);
            patient(|| {
                asked.set(asked.get() + 1);
                if asked.get() > away { Ok(asked.get()) } else { Err(error()) }
            })
        };
        let nobody = || Error::Request(RequestError::NobodyServes("logger/commands", "logger"));
        assert_eq!(ask(2, nobody).unwrap(), 3);
        let refused = ask(2, no_ring).unwrap_err();
        assert!(matches!(refused, Error::Logger(_)), "{refused}");
        let long = || {
            let service = "logger/commands";
            Error::Request(RequestError::TooLong { service, found: 2, most: 1 })
        };
        ask(2, long).unwrap_err();
        assert_eq!(asked.get(), 1);
    }

    #[test]
    fn no_more_than_the_ring_keeps_is_asked_for() {
        let of = |before, after| {
            let [before, after, length] = [before, after, 30].map(Duration::from_secs);
            check_times(before, after, length).map_err(|error| error.to_string())
        };
        assert_eq!(of(30, 30), Ok(()));
        assert_eq!(of(0, 0), Ok(()));
        assert!(of(31, 5).unwrap_err().starts_with("--before 31s: expected at most 30s"));
        assert!(of(5, 31).unwrap_err().starts_with("--after 31s: expected at most 30s"));
    }

    #[test]
    fn parts_are_held_although_their_names_go() {
        let folder = tempfile::tempdir().unwrap();
        let first = folder.path().join("ring.mcap");
        let path = |number| recording::part_path(&first, number);
        for number in [2, 3, 4] {
            std::fs::write(path(number), number.to_string()).unwrap();
        }
        let mut held = Held::default();
        let ring = |parts: &[u32]| RingStatus {
            first: first.to_str().unwrap().to_owned(),
            parts: parts.to_vec(),
            ..RingStatus::default()
        };
        held.take_hold(&ring(&[1, 2, 3])).unwrap();
        std::fs::remove_file(path(2)).unwrap();
        held.take_hold(&ring(&[3, 4])).unwrap();
        let ended = held.ended(&ring(&[3, 4]));
        let found: Vec<_> =
            ended.iter().map(|part| std::fs::read_to_string(&part.at).unwrap()).collect();
        assert_eq!(found, ["2", "3"], "not the present one");
        assert_eq!(ended[0].name, path(2));
    }
}

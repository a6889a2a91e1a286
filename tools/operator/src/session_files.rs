//! MATLAB files that are written while the protocol goes on: one at the end of each session.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use ipc_types::{LoggerRequest, SessionProgress};
use recorder::WantedSession;
use rig::protocol::Protocol;
use runtime::clock::now_ns;

use crate::{ChosenProtocol, RigLink};

/// How long the end of a session may take to be on the disk.
const WRITTEN_LIMIT: Duration = Duration::from_secs(10);
/// How long the end of a session that was stopped may take; there may be none.
const STOPPED_LIMIT: Duration = Duration::from_secs(3);
const POLL_PERIOD: Duration = Duration::from_millis(300);

/// A file, or why it is not there.
pub type Written = anyhow::Result<PathBuf>;

/// Writes the sessions' files in a thread of its own, so that the client's lease is renewed
/// meanwhile.
#[derive(Debug)]
pub struct SessionFiles {
    /// The recording that the files are made from.
    recording: PathBuf,
    /// Sessions of the protocol, and those whose files were asked for.
    sessions: u32,
    over: u32,
    /// Only sessions that began since then are this run's (ns, CLOCK_MONOTONIC).
    since_ns: u64,
    /// Whether the protocol was seen to be played.
    begun: bool,
    sender: Sender<(WantedSession, Duration)>,
    thread: JoinHandle<Vec<Written>>,
}

impl SessionFiles {
    /// Checks, before anything moves, that files `NAME1.mat` to `NAMEn.mat` can be written for a
    /// protocol, from the recording in progress; of one that is continued, those of the sessions
    /// that remain. The file of a session that is stopped will have a name of its own.
    ///
    /// # Errors
    /// Where the protocol has no sessions, nothing is recorded, or one of the files is there.
    pub fn new(link: &RigLink, chosen: &ChosenProtocol, name: &Path) -> anyhow::Result<Self> {
        let sessions = sessions_of(chosen.protocol());
        let recording = Self::check(link, chosen, name)?;
        let over = chosen.continues().unwrap_or(0);
        Ok(Self { begun: false, ..Self::begin(recording, name, sessions, over, now_ns()) })
    }

    /// Whether the files of a protocol's sessions can be written; the recording in progress.
    ///
    /// # Errors
    /// As [`SessionFiles::new`].
    pub fn check(link: &RigLink, chosen: &ChosenProtocol, name: &Path) -> anyhow::Result<PathBuf> {
        let protocol = chosen.protocol();
        let sessions = sessions_of(protocol);
        if sessions == 0 {
            bail!("--mat: the protocol \"{}\" has no sessions", protocol.name);
        }
        let recording = link.logger(&LoggerRequest::Status)?.recording.context(
            "--mat: the files are written from the recording, and nothing is being recorded: \
             `farreach rec start FILE` first",
        )?;
        let taken = |number: &u32| recorder::session_path(name, *number).exists();
        let over = chosen.continues().unwrap_or(0);
        if let Some(number) = (over + 1..=sessions).find(taken) {
            let taken = recorder::session_path(name, number);
            bail!("--mat: {} is there already; files are never overwritten", taken.display());
        }
        Ok(PathBuf::from(recording))
    }

    /// Goes on with the files of a protocol that another client began, which has ended since: those
    /// that are there already are its own. `sessions`: from those that were over before it began
    /// to all of the protocol.
    pub fn resume(recording: &Path, sessions: Range<u32>, name: &Path, since_ns: u64) -> Self {
        let written = |number: &u32| recorder::session_path(name, *number).exists();
        let Range { start, end } = sessions;
        let over = start + (start + 1..=end).take_while(written).count() as u32;
        Self::begin(recording.to_owned(), name, end, over, since_ns)
    }

    fn begin(recording: PathBuf, name: &Path, sessions: u32, over: u32, since_ns: u64) -> Self {
        let (sender, receiver) = channel::<(WantedSession, Duration)>();
        let (name, read) = (name.to_owned(), recording.clone());
        let thread = std::thread::spawn(move || {
            let mut written = Vec::new();
            while let Ok((wanted, limit)) = receiver.recv() {
                written.extend(write(&read, wanted, &name, limit).transpose());
            }
            written
        });
        Self { recording, sessions, over, since_ns, begun: true, sender, thread }
    }

    /// The files of the sessions that are over, of a protocol that was resumed, without those
    /// that were over before it began.
    pub fn earlier(&self, over_before: u32, name: &Path) -> impl Iterator<Item = PathBuf> {
        (over_before + 1..=self.over).map(|number| recorder::session_path(name, number))
    }

    /// The recording that the files are made from.
    pub fn recording(&self) -> &Path {
        &self.recording
    }

    /// Only sessions that began since then are this run's (ns, CLOCK_MONOTONIC).
    pub const fn since_ns(&self) -> u64 {
        self.since_ns
    }

    /// Writes the files of the sessions that have ended since the last call.
    pub fn see(&mut self, sessions: Option<&SessionProgress>) {
        self.begun |= sessions.is_some();
        self.ask_for_all(sessions.map_or(0, |sessions| sessions.over));
    }

    /// Asks for the files of all sessions up to a number.
    fn ask_for_all(&mut self, over: u32) {
        for number in self.over + 1..=over {
            self.ask_for(number, true, WRITTEN_LIMIT);
        }
        self.over = self.over.max(over);
    }

    fn ask_for(&self, number: u32, whole: bool, limit: Duration) {
        let wanted = WantedSession { number, since_ns: self.since_ns, whole };
        // The thread lives for as long as this end of the channel.
        let _ = self.sender.send((wanted, limit));
    }

    /// Waits for the files; also that of a session in which the protocol ended.
    pub fn finish(mut self, completed: bool) -> Vec<Written> {
        if completed {
            self.ask_for_all(self.sessions);
        } else if self.begun {
            self.ask_for(self.over + 1, false, STOPPED_LIMIT);
        }
        let Self { sender, thread, .. } = self;
        drop(sender);
        thread.join().unwrap_or_else(|_| {
            vec![Err(anyhow::anyhow!("--mat: the thread that writes the files failed"))]
        })
    }
}

/// Number of sessions of a protocol.
pub fn sessions_of(protocol: &Protocol) -> u32 {
    protocol.sequence().filter(|(_, segment)| segment.session).count() as u32
}

/// Writes the file of a session once its end is in the recording; `None` where a session that was
/// stopped has none.
fn write(
    recording: &Path,
    wanted: WantedSession,
    name: &Path,
    limit: Duration,
) -> anyhow::Result<Option<PathBuf>> {
    let begun = Instant::now();
    loop {
        if let Some(path) = recorder::write_session(recording, wanted, name)? {
            return Ok(Some(path));
        }
        if begun.elapsed() > limit {
            if !wanted.whole {
                return Ok(None);
            }
            bail!(
                "session {} is not in {} after {} s; `farreach rec export --to mat` writes \
                 its file later",
                wanted.number,
                recording.display(),
                limit.as_secs()
            );
        }
        std::thread::sleep(POLL_PERIOD);
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    /// Sessions that were over before a continued protocol began have their files elsewhere, or
    /// none.
    #[test]
    fn a_resumed_protocol_goes_on_after_the_files_that_are_its_own() {
        let folder = tempfile::tempdir().unwrap();
        let name = folder.path().join("S_");
        let resumed = |sessions| SessionFiles::resume(Path::new("run.mcap"), sessions, &name, 7);
        let continued = resumed(2..4);
        assert_eq!((continued.over, continued.earlier(2, &name).count()), (2, 0));
        assert_eq!(resumed(0..4).over, 0);
        let third = folder.path().join("S_3.mat");
        std::fs::write(&third, "").unwrap();
        let continued = resumed(2..4);
        assert_eq!(continued.earlier(2, &name).collect::<Vec<_>>(), [third]);
    }
}

//! What the processes were told about their rig.

use ipc_types::Profile;
use rig::RigFile;

/// The rig files of a recording, and its profile.
#[derive(Debug)]
pub struct Rigs {
    /// Each with the time from which it held [ns, CLOCK_MONOTONIC], in that order.
    files: Vec<(u64, RigFile)>,
    profile: Profile,
    began_ns: u64,
}

impl Rigs {
    /// A rig file, the profile that the rig had, and when the recording began [ns,
    /// CLOCK_MONOTONIC].
    pub fn new(rig: RigFile, profile: Profile, began_ns: u64) -> Self {
        Self { files: vec![(0, rig)], profile, began_ns }
    }

    /// Another rig file that processes which began from a time on [ns, CLOCK_MONOTONIC] were given;
    /// no earlier than that of the last one.
    pub fn push(&mut self, from_ns: u64, rig: RigFile) {
        self.files.push((from_ns, rig));
    }

    /// The rig file of a process that published first at a time [ns, CLOCK_MONOTONIC].
    pub(crate) fn at(&self, time_ns: u64) -> Option<&RigFile> {
        let (_, first) = self.files.first()?;
        let newest = self.files.iter().rev().find(|(from_ns, _)| *from_ns <= time_ns);
        Some(newest.map_or(first, |(_, rig)| rig))
    }

    pub(crate) const fn profile(&self) -> Profile {
        self.profile
    }

    /// A time since the recording began (s).
    pub(crate) const fn seconds(&self, time_ns: u64) -> f64 {
        (time_ns as f64 - self.began_ns as f64) * 1e-9
    }
}

//! What the checks share.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use anyhow::anyhow;
use runtime::{HostStall, MEASURED_FOR};

use crate::live::{Movement, RunningRig};

/// What a person asked for.
#[derive(Clone, Debug)]
pub(crate) struct Options {
    /// Folder of the recordings.
    pub(crate) folder: PathBuf,
    /// How long to wait for a pulse of the scanner (s).
    pub(crate) trigger_s: Option<f64>,
    /// A person has agreed that the motor gets power.
    pub(crate) may_move: bool,
}

/// What the checks share: options, the rig, and what is measured once for several of them.
pub(crate) struct Bench<'a> {
    pub(crate) options: &'a Options,
    pub(crate) stop: &'a AtomicBool,
    pub(crate) rig: Option<RunningRig>,
    /// Why there is no rig, in words.
    pub(crate) no_rig: String,
    stall: Option<HostStall>,
    /// The movement, once it was made.
    pub(crate) movement: Option<Movement>,
}

impl<'a> Bench<'a> {
    /// A bench without or with a rig.
    pub(crate) fn new(
        options: &'a Options,
        stop: &'a AtomicBool,
        rig: Result<RunningRig, String>,
    ) -> Self {
        let (rig, no_rig) = match rig {
            Ok(rig) => (Some(rig), String::new()),
            Err(why) => (None, why),
        };
        Self { options, stop, rig, no_rig, stall: None, movement: None }
    }

    /// Folder of the recordings.
    pub(crate) fn folder(&self) -> &'a Path {
        &self.options.folder
    }

    /// The rig that is up.
    pub(crate) fn rig(&mut self) -> anyhow::Result<&mut RunningRig> {
        self.rig.as_mut().ok_or_else(|| anyhow!("{}", self.no_rig))
    }

    /// Stalls of the host, measured once.
    pub(crate) fn stall(&mut self) -> HostStall {
        *self.stall.get_or_insert_with(|| HostStall::measure(MEASURED_FOR))
    }
}

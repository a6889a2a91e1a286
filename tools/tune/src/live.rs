//! Tuning on a rig that is up: movements played and recorded, the rig file changed.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context as _, bail};
use ipc_types::{LoggerRequest, SAMPLE, Sample, Split, TripCause, Verb};
use operator::{ChosenProtocol, RigLink, RunOutcome, reset_and_arm, run_protocol};
use rig::RigFile;
use rig::protocol::Protocol;
use runtime::{RigName, Subscriber};

use crate::recorded::passes;
use crate::tracking::{Followed, TrackingError};

/// How long the torque is observed before the motor moves.
const REST: Duration = Duration::from_secs(1);
const POLL_PERIOD: Duration = Duration::from_millis(20);

/// Why a movement ended early.
#[derive(Debug, thiserror::Error)]
pub enum Ended {
    /// The watchdog removed the motor's power.
    #[error("the rig tripped while {protocol} was played ({cause}); the recording so far: {file}")]
    Tripped {
        /// The protocol.
        protocol: String,
        /// Why.
        cause: TripCause,
        /// The recording.
        file: String,
    },
    /// A person or a signal ended it.
    #[error("stopped while {0} was played")]
    Stopped(String),
    /// A hand holds the handle.
    #[error(
        "the torque at the handle is {found:.2} N·m, and more than {limit:.2} N·m means that a \
         hand holds it; a rig is tuned with nobody at the handle: let go of it, or allow more with \
         --torque-limit"
    )]
    Hand {
        /// Largest torque (N·m or N).
        found: f64,
        /// What is allowed.
        limit: f64,
    },
}

/// A movement that was played and recorded.
#[derive(Clone, Debug)]
pub struct Movement {
    /// The recording.
    pub recording: PathBuf,
    /// Desired and measured positions.
    pub followed: Followed,
    /// Tracking error.
    pub error: TrackingError,
}

impl Movement {
    /// How the handle followed a protocol in a recording: its last pass.
    ///
    /// # Errors
    /// Where the recording cannot be read, or has no movement that is long enough.
    pub fn read(file: &Path, protocol: &Protocol) -> anyhow::Result<Self> {
        let followed = passes(file, protocol.identity(), None)?.pop().unwrap_or_default();
        let error = followed.error().with_context(|| {
            format!(
                "{}: no movement of {} that is long enough to evaluate",
                file.display(),
                protocol.name
            )
        })?;
        Ok(Self { recording: file.to_owned(), followed, error })
    }
}

/// A rig that is up, and how its progress is shown.
pub struct Bench<'a> {
    /// Name of the rig.
    pub name: &'a RigName,
    /// Connection to it.
    pub link: &'a RigLink,
    /// Ends what is being done.
    pub stop: &'a AtomicBool,
    /// Is told what is being done.
    pub progress: &'a mut dyn FnMut(&str),
    /// Largest torque of the hand that is allowed (N·m or N).
    pub torque_limit: f64,
}

impl Bench<'_> {
    /// Plays a protocol into a recording, which must not exist. The motor must have been armed by a
    /// person.
    ///
    /// # Errors
    /// [`Ended`] where a protocol did not run to its end; where the logger records already, or a
    /// process does not answer.
    pub fn record(&mut self, protocol: &Protocol, file: &Path) -> anyhow::Result<()> {
        self.nobody_holds_the_handle()?;
        let path = std::path::absolute(file).context("make the path absolute")?;
        let text = path.to_str().context("expected a path in UTF-8")?.to_owned();
        let request =
            LoggerRequest::Start { path: text, metadata: Vec::new(), split: Split::default() };
        accepted(self.link.logger(&request)?.error)?;
        let played = self.play(protocol, file);
        let stopped = self.link.logger(&LoggerRequest::Stop)?;
        played?;
        accepted(stopped.error)?;
        if stopped.lost > 0 {
            bail!("{}: {} messages are not on disk; tune again", file.display(), stopped.lost);
        }
        Ok(())
    }

    fn play(&mut self, protocol: &Protocol, file: &Path) -> anyhow::Result<()> {
        let mut samples = self.link.subscriber(SAMPLE)?;
        let (mut torque, limit) = (0.0_f64, self.torque_limit);
        let held = AtomicBool::new(false);
        let (stop, progress) = (self.stop, &mut self.progress);
        let chosen = ChosenProtocol::of(protocol.clone());
        let outcome = run_protocol(self.link, &chosen, &held, &mut |shown| {
            torque = torque.max(largest_torque(&mut samples));
            if torque > limit || stop.load(Ordering::Relaxed) {
                held.store(true, Ordering::Relaxed);
            }
            progress(&format!(
                "{}: {}, {:.0} of {:.0} s",
                protocol.name, shown.label, shown.elapsed_s, shown.duration_s
            ));
        })?;
        let name = protocol.name.clone();
        match outcome {
            RunOutcome::Completed { .. } => Ok(()),
            RunOutcome::Stopped { .. } if torque > limit => {
                Err(Ended::Hand { found: torque, limit }.into())
            }
            RunOutcome::Stopped { .. } => Err(Ended::Stopped(name).into()),
            RunOutcome::Tripped { cause, .. } => {
                let file = file.display().to_string();
                Err(Ended::Tripped { protocol: name, cause, file }.into())
            }
        }
    }

    /// Observes the handle at rest.
    fn nobody_holds_the_handle(&mut self) -> anyhow::Result<()> {
        (self.progress)("is anybody at the handle?");
        let mut samples = self.link.subscriber(SAMPLE)?;
        let begun = Instant::now();
        let mut found = 0.0_f64;
        while begun.elapsed() < REST {
            std::thread::sleep(POLL_PERIOD);
            found = found.max(largest_torque(&mut samples));
        }
        let limit = self.torque_limit;
        if found > limit { Err(Ended::Hand { found, limit }.into()) } else { Ok(()) }
    }

    /// Has the rig go on with another rig file: disarmed before, reset and armed after. Call it
    /// only for a person who has agreed to that.
    ///
    /// # Errors
    /// Where the file differs in more than control and model, or the processes do not come back.
    pub fn change_rig_file(&mut self, name: &Path, rig: &RigFile) -> anyhow::Result<()> {
        (self.progress)("the motor without power; processes start again with the new rig file");
        operator::verb(self.link, Verb::Disarm)?;
        operator::change_rig_file(self.name, name, rig)?;
        self.arm()
    }

    /// Resets and arms the rig; a verb is tried again while it is refused.
    ///
    /// # Errors
    /// Where a verb is still refused after 15 s.
    pub fn arm(&mut self) -> anyhow::Result<()> {
        let progress = &mut self.progress;
        reset_and_arm(self.link, self.stop, &mut |text| progress(text))
            .context("the rig could not be armed again")
    }
}

fn largest_torque(samples: &mut Subscriber<Sample>) -> f64 {
    let mut largest = 0.0_f64;
    while let Ok(Some(sample)) = samples.take() {
        if sample.torque_present & 1 == 1 && sample.slave_torque[0].is_finite() {
            largest = largest.max(sample.slave_torque[0].abs());
        }
    }
    largest
}

fn accepted(error: String) -> anyhow::Result<()> {
    if error.is_empty() { Ok(()) } else { bail!("the logger reports: {error}") }
}

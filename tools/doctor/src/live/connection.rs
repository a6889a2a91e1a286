//! The rig that is up, as an observer sees it.

use std::time::{Duration, Instant};

use ipc_types::{
    CardKind, EnableToken, ExperimentRequest, SAMPLE, SCANNER, Sample, ScannerPulse, TOKEN,
    WatchdogState,
};
use operator::RigLink;
use rig::RigFile;
use runtime::{RigName, machine_report};

/// How long the rig is observed at rest.
const OBSERVED_FOR: Duration = Duration::from_secs(1);
/// Longest silence of acquisition and watchdog.
const SILENCE_LIMIT: Duration = Duration::from_secs(1);
const POLL_PERIOD: Duration = Duration::from_millis(10);

/// A rig that is up.
#[derive(Debug)]
pub(crate) struct RunningRig {
    pub(crate) link: RigLink,
    /// Its rig file; `None` where farreach's launcher did not start it.
    pub(crate) file: Option<RigFile>,
    observed: Option<Observed>,
}

/// A second of samples.
#[derive(Clone, Debug, Default)]
pub(crate) struct Observed {
    /// The samples.
    pub(crate) samples: Vec<Sample>,
    /// How long it was observed (s).
    pub(crate) seconds: f64,
}

impl RunningRig {
    /// Joins a rig; the error says why it cannot.
    pub(crate) fn join(name: &RigName) -> Result<Self, operator::Error> {
        let link = RigLink::open(name)?;
        Ok(Self { link, file: operator::rig_of(name).ok(), observed: None })
    }

    /// State of the watchdog; `None` where it is silent.
    pub(crate) fn state(&self) -> Option<WatchdogState> {
        let mut tokens = self.link.subscriber(TOKEN).ok()?;
        let token: EnableToken = first(|| tokens.latest().ok().flatten())?;
        WatchdogState::from_code(token.state)
    }

    /// The protocol that is being played, if one is.
    pub(crate) fn protocol(&self) -> Option<String> {
        let answer = self.link.experiment(&ExperimentRequest::Status).ok()?;
        answer.running.then_some(answer.name)
    }

    /// Why nothing may disturb the rig; `None` where it may be disturbed.
    pub(crate) fn in_use(&self) -> Option<String> {
        if let Some(name) = self.protocol() {
            return Some(format!("protocol {name} is running"));
        }
        match self.state() {
            Some(state @ (WatchdogState::Armed | WatchdogState::Enabled)) => {
                Some(format!("the rig is {state}"))
            }
            _ => None,
        }
    }

    /// The card behind acquisition; `None` where no sample comes.
    pub(crate) fn card(&self) -> Option<CardKind> {
        let mut samples = self.link.subscriber(SAMPLE).ok()?;
        CardKind::from_code(first(|| samples.latest().ok().flatten())?.backend)
    }

    /// A second of what the rig publishes; observed once.
    pub(crate) fn observed(&mut self) -> anyhow::Result<&Observed> {
        if self.observed.is_none() {
            self.observed = Some(self.observe(OBSERVED_FOR)?);
        }
        // Just observed; a rig that publishes nothing has an empty observation.
        Ok(self.observed.get_or_insert_default())
    }

    fn observe(&self, duration: Duration) -> anyhow::Result<Observed> {
        let mut samples = self.link.subscriber(SAMPLE)?;
        let mut found = Observed::default();
        let begun = Instant::now();
        while begun.elapsed() < duration {
            std::thread::sleep(POLL_PERIOD);
            while let Some(sample) = samples.take()? {
                found.samples.push(sample);
            }
        }
        found.seconds = begun.elapsed().as_secs_f64();
        Ok(found)
    }

    /// Waits for a pulse of the scanner; returns how many came until the first was seen.
    pub(crate) fn pulses(&self, limit: Duration) -> anyhow::Result<u64> {
        let mut pulses = self.link.subscriber(SCANNER)?;
        // The topic has a history, of pulses before this.
        let from_ns = runtime::clock::now_ns();
        let begun = Instant::now();
        let mut count = 0;
        while begun.elapsed() < limit && count == 0 {
            std::thread::sleep(POLL_PERIOD);
            while let Some(pulse) = pulses.take()? {
                count += u64::from(is_pulse(&pulse) && pulse.at_ns >= from_ns);
            }
        }
        Ok(count)
    }

    /// What the report says of it.
    pub(crate) fn examined(&self) -> machine_report::ExaminedRig {
        let file = self.file.as_ref();
        machine_report::ExaminedRig {
            name: file.map_or_else(|| "unknown".to_owned(), |file| file.name.clone()),
            identity: file.map_or_else(String::new, |file| format!("{:016x}", file.identity())),
            card: self.card().map_or("unknown", CardKind::text).to_owned(),
            profile: self.link.domain().profile().text().to_owned(),
        }
    }
}

fn is_pulse(pulse: &ScannerPulse) -> bool {
    pulse.kind == ipc_types::LineEvent::Pulse.code()
}

/// The first value that comes within a second.
pub(super) fn first<T>(mut next: impl FnMut() -> Option<T>) -> Option<T> {
    let begun = Instant::now();
    loop {
        if let Some(found) = next() {
            return Some(found);
        }
        if begun.elapsed() > SILENCE_LIMIT {
            return None;
        }
        std::thread::sleep(Duration::from_millis(2));
    }
}

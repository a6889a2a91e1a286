//! The newest messages of the topics that are inputs, as a loop finds them when it looks.

use std::collections::VecDeque;

use ipc_types::{EnableLine, EnableToken, Message, MotorCommand, Sample, ScannerPulse, Setpoint};

/// Messages that are kept, by topic: half a minute of samples at 2 kHz. A process that was stopped
/// between receiving and computing may use older ones, which are then missing.
const KEPT: usize = 65_536;

/// The newest messages of a topic, numbered from 0 in the order of publishing.
#[derive(Debug)]
pub(crate) struct History<T> {
    messages: VecDeque<T>,
    /// Number of the oldest one kept.
    first: u64,
    most: usize,
}

impl<T: Message> History<T> {
    fn new(most: usize) -> Self {
        Self { messages: VecDeque::new(), first: 0, most }
    }

    fn push(&mut self, message: &T) {
        if self.messages.len() == self.most {
            self.messages.pop_front();
            self.first += 1;
        }
        self.messages.push_back(*message);
    }

    /// Number of the next message.
    pub(crate) fn end(&self) -> u64 {
        self.first + self.messages.len() as u64
    }

    /// Number of the newest message from number `from` on that fits.
    pub(crate) fn newest(&self, from: u64, fits: impl Fn(&T) -> bool) -> Option<u64> {
        let skipped = usize::try_from(from.saturating_sub(self.first)).ok()?;
        let mut places = (skipped..self.messages.len()).rev();
        places.find(|&at| self.messages.get(at).is_some_and(&fits)).map(|at| self.first + at as u64)
    }

    /// The message of a number; `None` where it is not kept.
    pub(crate) fn get(&self, number: u64) -> Option<&T> {
        self.messages.get(usize::try_from(number.checked_sub(self.first)?).ok()?)
    }

    /// The newest message that fits.
    pub(crate) fn find(&self, fits: impl Fn(&T) -> bool) -> Option<&T> {
        self.messages.iter().rev().find(|message| fits(message))
    }
}

/// The inputs of all cores.
#[derive(Debug)]
pub(crate) struct Inputs {
    pub(crate) samples: History<Sample>,
    pub(crate) setpoints: History<Setpoint>,
    pub(crate) commands: History<MotorCommand>,
    pub(crate) tokens: History<EnableToken>,
    /// Events of the scanner's line.
    pub(crate) pulses: History<ScannerPulse>,
    /// Pulses that were typed as the key 5.
    pub(crate) keys: History<ScannerPulse>,
}

impl Inputs {
    pub(crate) fn new() -> Self {
        Self {
            samples: History::new(KEPT),
            // Large, and a lease is short.
            setpoints: History::new(KEPT / 16),
            commands: History::new(KEPT / 2),
            tokens: History::new(KEPT / 2),
            // At most some dozens in a second.
            pulses: History::new(KEPT / 16),
            keys: History::new(KEPT / 16),
        }
    }

    /// Takes a message of any of the topics.
    pub(crate) fn take(&mut self, message: &Recorded<'_>) {
        match message {
            Recorded::Sample(sample) => self.samples.push(sample),
            Recorded::Setpoint(setpoint) => self.setpoints.push(setpoint),
            Recorded::Command(command) => self.commands.push(command),
            Recorded::Token(token) => self.tokens.push(token),
            Recorded::Pulse(pulse) => self.pulses.push(pulse),
            Recorded::Key(key) => self.keys.push(key),
            // An input of the card alone.
            Recorded::Line(_) => {}
        }
    }
}

/// A recorded message of one of the topics that the cores read or write.
#[derive(Clone, Copy, Debug)]
pub enum Recorded<'a> {
    /// From acquisition.
    Sample(&'a Sample),
    /// From experiment or operator.
    Setpoint(&'a Setpoint),
    /// From control.
    Command(&'a MotorCommand),
    /// From the watchdog.
    Token(&'a EnableToken),
    /// From the watchdog, after the token of the same cycle.
    Line(&'a EnableLine),
    /// From acquisition: an event of the scanner's line.
    Pulse(&'a ScannerPulse),
    /// From the experiment: a pulse that was typed as the key 5.
    Key(&'a ScannerPulse),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_stay_when_old_messages_go() {
        let mut history = History::new(3);
        for tick in 0..5 {
            history.push(&Sample { tick, ..Sample::default() });
        }
        assert_eq!((history.end(), history.get(1), history.get(5)), (5, None, None));
        assert_eq!(history.get(2).unwrap().tick, 2);
        assert_eq!(history.newest(0, |sample| sample.tick <= 3), Some(3));
        assert_eq!(history.newest(4, |sample| sample.tick <= 3), None);
        assert_eq!(history.newest(9, |_| true), None);
        assert_eq!(history.find(|sample| sample.tick % 2 == 0).unwrap().tick, 4);
    }
}

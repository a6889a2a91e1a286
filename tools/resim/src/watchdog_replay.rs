//! The watchdog, run again: the cycle of each recorded token once more, at the time that it names,
//! with as many samples and commands as it says to have received, and the verb that it executed.
//!
//! Whether launcher, keeper and logger lived is no message; the token's faults tell it. An
//! interlock is known from its start on only: it remembers faults, windows of speed and travel,
//! and the times of its tokens.

use std::collections::BTreeMap;

use ipc_types::{EnableLine, EnableToken, Message, TripCause, Verb, WatchdogState};
use watchdog::interlock::{Config, Interlock, Outputs, PRIORITY, Peers};

use crate::difference::first_difference;
use crate::history::{History, Inputs};
use crate::report::{Begin, CoreReport, Difference, NotCompared, Trip, Used};
use crate::rigs::Rigs;
use crate::used::{used_command, used_sample};

/// What the interlock is told, and does not compute.
const GIVEN: [&str; 7] = [
    "session",
    "incarnation",
    "time_ns",
    "cycles_missed",
    "samples_received",
    "commands_received",
    "verb",
];

/// One watchdog process.
#[derive(Debug)]
struct Process {
    /// `None` where its state does not follow from the messages, and why.
    interlock: Result<Box<Interlock>, NotCompared>,
    /// Sequence number of its next token.
    next: u64,
    samples: Received,
    commands: Received,
    /// The newest token, as recorded.
    newest: Option<EnableToken>,
    /// How often the enable line was toggled, as computed again.
    toggles: u64,
}

/// What the watchdog has received of a topic.
#[derive(Clone, Copy, Debug, Default)]
struct Received {
    /// How many messages.
    count: u64,
    /// Number of the next message of the recording.
    next: u64,
}

/// The watchdog, run again.
#[derive(Debug)]
pub(crate) struct WatchdogReplay {
    pub(crate) report: CoreReport,
    /// The enable line.
    pub(crate) lines: CoreReport,
    pub(crate) trips: Vec<Trip>,
    processes: BTreeMap<u64, Process>,
}

impl WatchdogReplay {
    pub(crate) fn new() -> Self {
        Self {
            report: CoreReport::new("watchdog", "token"),
            lines: CoreReport::new("enable line", "enable_line"),
            trips: Vec::new(),
            processes: BTreeMap::new(),
        }
    }

    /// Takes a token that a program of somebody else's published.
    pub(crate) fn skip(&mut self, token: &EnableToken) {
        self.processes.remove(&token.incarnation);
        self.report.messages += 1;
        self.report.skip(NotCompared::Replaced);
    }

    /// Takes a state of the enable line that a program of somebody else's published.
    pub(crate) fn skip_line(&mut self) {
        self.lines.messages += 1;
        self.lines.skip(NotCompared::Replaced);
    }

    /// Takes a state of the enable line. The token of the same cycle has been taken before it.
    pub(crate) fn see_line(&mut self, line: &EnableLine, inputs: &Inputs, rigs: &Rigs) {
        self.lines.messages += 1;
        let process = self.processes.get(&line.incarnation);
        let token = process.and_then(|process| process.newest);
        let Some((process, token)) =
            process.zip(token.filter(|token| token.sequence == line.sequence))
        else {
            return self.lines.skip(NotCompared::MessagesMissing);
        };
        if let Err(why) = &process.interlock {
            return self.lines.skip(*why);
        }
        let again = EnableLine { epoch: token.epoch, toggles: process.toggles, ..*line };
        let field = first_difference(line, &again, |_| true);
        self.lines.compare(field, |field| Difference {
            topic: "enable_line",
            incarnation: line.incarnation,
            sequence: line.sequence,
            tick: token.sample_tick,
            at_s: rigs.seconds(line.time_ns),
            field,
            inputs: used(&token, inputs),
        });
    }

    /// Takes a token. Samples and commands have been taken before it.
    pub(crate) fn see(&mut self, token: &EnableToken, inputs: &Inputs, rigs: &Rigs) {
        self.report.messages += 1;
        let Some(rig) = rigs.at(token.time_ns) else { return };
        let at_s = rigs.seconds(token.issued_ns);
        let process = self.processes.entry(token.incarnation).or_insert_with(|| {
            Process::new((token.sequence == 0).then(|| {
                Config::for_profile(rigs.profile(), token.session, token.incarnation, rig)
            }))
        });
        if token.sequence == 0 {
            self.report.begins.push(Begin {
                at_s,
                incarnation: token.incarnation,
                from: "the start of the process",
            });
        }
        if token.sequence != process.next {
            process.forget(NotCompared::MessagesMissing);
        }
        process.next = token.sequence.saturating_add(1);
        let again = process.step(token, inputs);
        let latched = [WatchdogState::Tripped, WatchdogState::Faulted].map(WatchdogState::code);
        let before = process.newest.replace(*token).map(|before| before.state);
        if latched.contains(&token.state) && before.is_some_and(|before| before != token.state) {
            self.trips.push(trip(token, again.as_ref().ok(), inputs, at_s));
        }
        match again {
            Ok(again) => {
                let field = first_difference(token, &again, |name| !GIVEN.contains(&name));
                self.report.compare(field, |field| Difference {
                    topic: "token",
                    incarnation: token.incarnation,
                    sequence: token.sequence,
                    tick: token.sample_tick,
                    at_s,
                    field,
                    inputs: used(token, inputs),
                });
            }
            Err(why) => self.report.skip(why),
        }
    }
}

/// Whether a fault is active in a token.
const fn has(token: &EnableToken, cause: TripCause) -> bool {
    token.faults & (1 << cause.code()) != 0
}

/// A trip as recorded and computed again.
fn trip(token: &EnableToken, again: Option<&EnableToken>, inputs: &Inputs, at_s: f64) -> Trip {
    let cause = |token: &EnableToken| {
        TripCause::from_code(token.cause).map_or("unknown", TripCause::text).to_owned()
    };
    let source = again.unwrap_or(token);
    let active = PRIORITY.iter().filter(|cause| has(source, **cause));
    Trip {
        at_s,
        incarnation: token.incarnation,
        sequence: token.sequence,
        state: WatchdogState::from_code(token.state).map_or("unknown", WatchdogState::text),
        recorded: cause(token),
        recomputed: again.map(cause),
        faults: active.map(|cause| cause.text().to_owned()).collect(),
        inputs: used(token, inputs),
    }
}

/// The newest sample and command that a token was computed from, in words.
fn used(token: &EnableToken, inputs: &Inputs) -> Vec<Used> {
    let sample = inputs.samples.find(|sample| {
        sample.tick == token.sample_tick && sample.incarnation == token.acquisition_incarnation
    });
    let command = inputs.commands.find(|command| {
        command.sequence == token.command_sequence
            && command.incarnation == token.control_incarnation
    });
    let mut used: Vec<Used> =
        sample.map(|sample| used_sample(sample, token.issued_ns)).into_iter().collect();
    used.extend(command.map(|command| used_command(command, token.issued_ns)));
    let verb = Verb::from_executed_code(token.verb)
        .map_or_else(String::new, |verb| format!(", executing {verb}"));
    used.push(Used {
        topic: "token",
        incarnation: token.incarnation,
        sequence: token.sequence,
        text: format!("issued at {} ns{verb}", token.issued_ns),
    });
    used
}

impl Process {
    /// With its configuration where its first token is recorded.
    fn new(config: Option<Config>) -> Self {
        let interlock = config.map(|config| Box::new(Interlock::new(config)));
        Self {
            interlock: interlock.ok_or(NotCompared::BeganBefore),
            next: 0,
            samples: Received::default(),
            commands: Received::default(),
            newest: None,
            toggles: 0,
        }
    }

    /// The state does not follow from what was seen any more.
    fn forget(&mut self, why: NotCompared) {
        if self.interlock.is_ok() {
            self.interlock = Err(why);
        }
    }

    /// Runs the cycle of a token.
    fn step(&mut self, token: &EnableToken, inputs: &Inputs) -> Result<EnableToken, NotCompared> {
        let interlock = match &mut self.interlock {
            Ok(interlock) => interlock,
            Err(why) => return Err(*why),
        };
        let samples =
            self.samples.take(token.samples_received, token.issued_ns, &inputs.samples, |sample| {
                sample.tick == token.sample_tick
                    && sample.incarnation == token.acquisition_incarnation
            });
        let commands = self.commands.take(
            token.commands_received,
            token.issued_ns,
            &inputs.commands,
            |command| {
                command.sequence == token.command_sequence
                    && command.incarnation == token.control_incarnation
            },
        );
        let (Some(samples), Some(commands)) = (samples, commands) else {
            self.forget(NotCompared::InputMissing);
            return Err(NotCompared::InputMissing);
        };
        for sample in samples.filter_map(|number| inputs.samples.get(number)) {
            interlock.observe_sample(sample);
        }
        for command in commands.filter_map(|number| inputs.commands.get(number)) {
            interlock.observe_command(command);
        }
        if let Some(verb) = Verb::from_executed_code(token.verb) {
            // A refusal shows in the state.
            let _state = interlock.command(verb, token.issued_ns);
        }
        let peers = Peers {
            launcher_alive: !has(token, TripCause::LauncherLost),
            keeper_alive: !has(token, TripCause::KeeperLost),
            logger_alive: !has(token, TripCause::LoggerLost),
        };
        let Outputs { token, toggle_line, .. } = interlock.step(token.issued_ns, peers);
        self.toggles += u64::from(toggle_line);
        Ok(token)
    }
}

impl Received {
    /// The numbers of the messages that came in a cycle, after which `count` were received in all;
    /// `None` where they are not all in the recording. `newest` tells the one that the cycle took
    /// last.
    fn take<T: Message>(
        &mut self,
        count: u64,
        now_ns: u64,
        history: &History<T>,
        newest: impl Fn(&T) -> bool,
    ) -> Option<std::ops::Range<u64>> {
        let came = count.checked_sub(self.count)?;
        if came == 0 {
            return Some(self.next..self.next);
        }
        let last =
            history.newest(self.next, |message| newest(message) && message.time_ns() <= now_ns);
        // One that was refused is not the newest: then they are those that follow.
        let end = last.map_or(self.next.saturating_add(came), |last| last + 1);
        let begin = end.checked_sub(came)?;
        if begin < self.next || end > history.end() || history.get(begin).is_none() {
            return None;
        }
        (self.count, self.next) = (count, end);
        Some(begin..end)
    }
}

//! Control, run again: each recorded command is computed again from the sample, the setpoint and
//! the token that it names, at the time that it names.

use std::collections::BTreeMap;

use control::cycle::Seen;
use control::law::{Law, LawConfig};
use ipc_types::program_flow::{CONTROL_CYCLE, signature};
use ipc_types::{EnableToken, Mode, MotorCommand, Sample, Setpoint};

use crate::convergence::Convergence;
use crate::difference::first_difference;
use crate::history::Inputs;
use crate::other_gains::{Comparison, OtherLaw};
use crate::report::{Begin, CoreReport, Difference, NotCompared, Used};
use crate::rigs::Rigs;
use crate::used::{used_sample, used_setpoint, used_token};

/// What the law is told, and does not compute.
const GIVEN: [&str; 6] =
    ["session", "incarnation", "sequence", "time_ns", "cycles_missed", "profile"];

/// What is known of a law's state.
#[derive(Debug)]
enum State {
    /// Nothing, and why.
    Unknown(NotCompared),
    /// It converges, for the same reason.
    Converging(NotCompared, Box<Convergence>),
    /// All.
    Known(Box<Law>),
}

/// One control process.
#[derive(Debug)]
struct Process {
    /// Sequence number of its next command.
    next: u64,
    config: LawConfig,
    sample: Option<Box<Sample>>,
    setpoint: Option<Box<Setpoint>>,
    token: Option<EnableToken>,
    state: State,
    other: Option<OtherLaw>,
}

/// Control, run again.
#[derive(Debug)]
pub(crate) struct ControlReplay {
    pub(crate) report: CoreReport,
    /// By incarnation: an earlier one may wake beside its successor.
    processes: BTreeMap<u64, Process>,
    /// The gains of another rig file.
    other: Option<LawConfig>,
    pub(crate) compared_with_other: Comparison,
}

impl ControlReplay {
    pub(crate) fn new(other: Option<LawConfig>) -> Self {
        Self {
            report: CoreReport::new("control", "command"),
            processes: BTreeMap::new(),
            other,
            compared_with_other: Comparison::default(),
        }
    }

    /// Takes a command that a program of somebody else's published.
    pub(crate) fn skip(&mut self, command: &MotorCommand) {
        self.processes.remove(&command.incarnation);
        self.report.messages += 1;
        self.report.skip(NotCompared::Replaced);
    }

    /// Takes a command. Its inputs have been taken before it.
    pub(crate) fn see(&mut self, command: &MotorCommand, inputs: &Inputs, rigs: &Rigs) {
        self.report.messages += 1;
        let Some(rig) = rigs.at(command.time_ns) else { return };
        let other = self.other;
        let process = self.processes.entry(command.incarnation).or_insert_with(|| {
            let config = LawConfig::of_rig(rig);
            Process::new(config, other, command.sequence == 0)
        });
        if command.sequence == 0 {
            self.report.begins.push(Begin {
                at_s: rigs.seconds(command.computed_ns),
                incarnation: command.incarnation,
                from: "the start of the process",
            });
        }
        if command.sequence != process.next {
            process.forget(NotCompared::MessagesMissing);
        }
        process.next = command.sequence.saturating_add(1);
        if !process.find_inputs(command, inputs) {
            process.forget(NotCompared::InputMissing);
            self.report.skip(NotCompared::InputMissing);
            return;
        }
        let Some(sample) = process.sample.as_deref() else { return };
        let seen = Seen {
            sample,
            setpoint: process.setpoint.as_deref(),
            token: process.token.as_ref(),
            incarnation: command.incarnation,
        };
        let stepped = step(&mut process.state, &process.config, &seen, command.computed_ns);
        if let Some(other) = &mut process.other {
            let compared = matches!(process.state, State::Known(_));
            other.see(command, &seen, compared, rigs, &mut self.compared_with_other);
        }
        match stepped {
            Stepped::Computed(mut again) => {
                again.flow = signature(CONTROL_CYCLE, again.token_sequence);
                let field = first_difference(command, &again, |name| !GIVEN.contains(&name));
                self.report.compare(field, |field| Difference {
                    topic: "command",
                    incarnation: command.incarnation,
                    sequence: command.sequence,
                    tick: command.sample_tick,
                    at_s: rigs.seconds(command.computed_ns),
                    field,
                    inputs: used(&seen, command),
                });
            }
            Stepped::Skipped(why) => self.report.skip(why),
            Stepped::Settled(why) => {
                self.report.skip(why);
                self.report.begins.push(Begin {
                    at_s: rigs.seconds(command.computed_ns),
                    incarnation: command.incarnation,
                    from: "a stretch without power, in which the law's state came to depend on \
                           its inputs alone",
                });
            }
        }
    }
}

/// What came of a step.
#[derive(Debug)]
enum Stepped {
    Computed(Box<MotorCommand>),
    Skipped(NotCompared),
    /// The state is known from the next step on.
    Settled(NotCompared),
}

fn step(state: &mut State, config: &LawConfig, seen: &Seen<'_>, now_ns: u64) -> Stepped {
    match state {
        State::Known(law) => Stepped::Computed(Box::new(seen.step(law, now_ns))),
        State::Unknown(why) if seen.powered() => Stepped::Skipped(*why),
        State::Unknown(why) => {
            let why = *why;
            let mut laws = Box::new(Convergence::new(config, seen, now_ns));
            laws.step(seen, now_ns);
            *state = State::Converging(why, laws);
            Stepped::Skipped(why)
        }
        State::Converging(why, _) if seen.powered() => {
            let why = *why;
            *state = State::Unknown(why);
            Stepped::Skipped(why)
        }
        State::Converging(why, laws) => {
            let why = *why;
            laws.step(seen, now_ns);
            let Some(law) = laws.settled() else { return Stepped::Skipped(why) };
            *state = State::Known(Box::new(law.clone()));
            Stepped::Settled(why)
        }
    }
}

impl Process {
    fn new(config: LawConfig, other: Option<LawConfig>, begins: bool) -> Self {
        let state = if begins {
            State::Known(Box::new(Law::new(config)))
        } else {
            State::Unknown(NotCompared::BeganBefore)
        };
        Self {
            // What the process published before the recording is not missing in it.
            next: 0,
            config,
            sample: None,
            setpoint: None,
            token: None,
            state,
            other: other.map(OtherLaw::new),
        }
    }

    /// The state does not follow from what was seen any more. Where it did not before, the first
    /// reason stays.
    fn forget(&mut self, why: NotCompared) {
        let why = match &self.state {
            State::Known(_) => why,
            State::Unknown(first) | State::Converging(first, _) => *first,
        };
        self.state = State::Unknown(why);
    }

    /// Finds the messages that a command was computed from; `false` where one is missing.
    fn find_inputs(&mut self, command: &MotorCommand, inputs: &Inputs) -> bool {
        let is_sample = |sample: &Sample| {
            sample.tick == command.sample_tick && sample.scan_time_ns == command.sample_time_ns
        };
        if !self.sample.as_deref().is_some_and(is_sample) {
            self.sample = inputs.samples.find(is_sample).map(|sample| Box::new(*sample));
        }
        let held = (command.held_incarnation, command.held_sequence);
        let is_held = |setpoint: &Setpoint| (setpoint.incarnation, setpoint.sequence) == held;
        if held.0 == 0 {
            self.setpoint = None;
        } else if !self.setpoint.as_deref().is_some_and(is_held) {
            let found = inputs.setpoints.find(is_held);
            self.setpoint = found.map(|setpoint| Box::new(*setpoint));
        }
        let named = (command.epoch, command.token_sequence);
        let is_named = |token: &EnableToken| (token.epoch, token.sequence) == named;
        if !self.token.as_ref().is_some_and(is_named) {
            self.token = inputs.tokens.find(is_named).copied();
        }
        // The first token of a watchdog is no permission: none gives the same.
        let has_token = self.token.is_some() || named == (0, 0);
        self.sample.is_some() && (held.0 == 0 || self.setpoint.is_some()) && has_token
    }
}

/// What a command was computed from, in words.
fn used(seen: &Seen<'_>, command: &MotorCommand) -> Vec<Used> {
    let mut used = vec![used_sample(seen.sample, command.computed_ns)];
    used.extend(seen.setpoint.map(|setpoint| used_setpoint(setpoint, command.computed_ns)));
    used.extend(seen.token.map(|token| used_token(token, command.computed_ns)));
    let mode = Mode::from_code(command.mode).map_or("unknown", Mode::text);
    let power = if seen.powered() { "with power" } else { "without power" };
    used.push(Used {
        topic: "command",
        incarnation: command.incarnation,
        sequence: command.sequence,
        text: format!("computed at {} ns, {power}, mode {mode}", command.computed_ns),
    });
    used
}

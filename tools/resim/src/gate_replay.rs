//! The gate, run again: the cycle of each recorded sample once more, at the time that it names,
//! with the tokens and commands up to those that it names.
//!
//! A cycle in which acquisition found no scan has no sample. The gate's count of cycles tells how
//! many there were; their times are taken as evenly spaced, and where the result then differs the
//! sample is not compared.

use std::collections::BTreeMap;

use ipc_types::program_flow::{ACQUISITION_CYCLE, signature};
use ipc_types::{AXES, COMMAND, GateCause, GateState, Message, Sample, TOKEN, Topic};
use runtime::gate::{Gate, GateConfig, GateOutput};

use crate::difference::{FieldDifference, first_difference};
use crate::history::{History, Inputs};
use crate::report::{Begin, CoreReport, Difference, NotCompared, Used};
use crate::rigs::Rigs;
use crate::used::{used_command, used_token};

/// What the gate computes of a sample.
const COMPUTED: [&str; 8] = [
    "output_v",
    "epoch",
    "token_sequence",
    "command_incarnation",
    "command_sequence",
    "flow",
    "gate_state",
    "gate_cause",
];

/// One acquisition process.
#[derive(Debug)]
struct Process {
    config: GateConfig,
    gate: Gate,
    /// Why its state does not follow from the messages yet; `None` where it does.
    unknown: Option<NotCompared>,
    /// Whether it is known why the last epoch ended.
    cause_known: bool,
    /// Cycles of the gate up to the newest sample, and the time of the last one.
    cycles: u64,
    last_ns: u64,
    output: Option<GateOutput>,
    /// Numbers of the next token and command that it has not been shown.
    next_token: u64,
    next_command: u64,
    shown: bool,
}

/// The gate, run again.
#[derive(Debug)]
pub(crate) struct GateReplay {
    pub(crate) report: CoreReport,
    processes: BTreeMap<u64, Process>,
}

/// How a cycle relates to what was seen before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Cycle {
    /// Another sample of the newest one.
    Same,
    /// The next one.
    Next,
    /// So many of which no sample tells lie between.
    After(u64),
}

/// Numbers of the newest token and command that a cycle was shown: `None` where no new one came.
#[derive(Clone, Copy, Debug)]
struct Received {
    token: Option<u64>,
    command: Option<u64>,
}

impl GateReplay {
    pub(crate) fn new() -> Self {
        Self { report: CoreReport::new("gate", "sample"), processes: BTreeMap::new() }
    }

    /// Takes a sample that a program of somebody else's published.
    pub(crate) fn skip(&mut self, sample: &Sample) {
        self.processes.remove(&sample.incarnation);
        self.report.messages += 1;
        self.report.skip(NotCompared::Replaced);
    }

    /// Takes a sample. Tokens and commands have been taken before it.
    pub(crate) fn see(&mut self, sample: &Sample, inputs: &Inputs, rigs: &Rigs) {
        self.report.messages += 1;
        let Some(config) = config(sample, rigs) else { return };
        let process = self
            .processes
            .entry(sample.incarnation)
            .or_insert_with(|| Process::new(config, sample.sequence == 0, sample.gate_cycles));
        let at_s = rigs.seconds(sample.gate_ns);
        let begin = |from| Begin { at_s, incarnation: sample.incarnation, from };
        if sample.sequence == 0 {
            self.report.begins.push(begin("the start of the process"));
        }
        let cycle = match sample.gate_cycles.checked_sub(process.cycles) {
            Some(0) => Cycle::Same,
            Some(1) => Cycle::Next,
            Some(more) => Cycle::After(more - 1),
            None => {
                process.forget(NotCompared::MessagesMissing);
                Cycle::Next
            }
        };
        if cycle != Cycle::Same {
            match process.received(sample, inputs) {
                Some(received) => process.run(sample, inputs, received, cycle),
                None => process.forget(NotCompared::InputMissing),
            }
        }
        (process.cycles, process.last_ns) = (sample.gate_cycles, sample.gate_ns);
        let Some(output) = process.output.filter(|_| process.unknown.is_none()) else {
            let why = process.unknown.unwrap_or(NotCompared::InputMissing);
            if process.settles(sample) {
                self.report.begins.push(begin("the opening of the gate"));
            }
            self.report.skip(why);
            return;
        };
        let field = differs(sample, &output, process.cause_known);
        if field.is_some() && matches!(cycle, Cycle::After(_)) {
            process.forget(NotCompared::CyclesWithoutSample);
            self.report.skip(NotCompared::CyclesWithoutSample);
            return;
        }
        self.report.compare(field, |field| Difference {
            topic: "sample",
            incarnation: sample.incarnation,
            sequence: sample.sequence,
            tick: sample.tick,
            at_s,
            field,
            inputs: used(process, sample, inputs),
        });
    }
}

/// What the acquisition process that sent a sample gave its gate.
fn config(sample: &Sample, rigs: &Rigs) -> Option<GateConfig> {
    let rig = rigs.at(sample.time_ns)?;
    let mut volts_max = [0.0; AXES];
    for (limit, axis) in volts_max.iter_mut().zip(&rig.axes) {
        *limit = axis.limits.volts_max;
    }
    let (session, incarnation) = (sample.session, sample.incarnation);
    Some(GateConfig::for_profile(rigs.profile(), session, incarnation, rig.axes.len(), volts_max))
}

/// The first field of a sample that the gate's output does not have.
fn differs(sample: &Sample, output: &GateOutput, cause_known: bool) -> Option<FieldDifference> {
    let again = Sample {
        output_v: output.volts,
        epoch: output.epoch,
        token_sequence: output.token_sequence,
        command_incarnation: output.command_incarnation,
        command_sequence: output.command_sequence,
        flow: signature(ACQUISITION_CYCLE, output.token_sequence),
        gate_state: output.state.code(),
        gate_cause: output.cause.code(),
        ..*sample
    };
    let compared = |name: &str| COMPUTED.contains(&name) && (cause_known || name != "gate_cause");
    first_difference(sample, &again, compared)
}

/// The newest token and command that a cycle had, in words.
fn used(process: &Process, sample: &Sample, inputs: &Inputs) -> Vec<Used> {
    let token = process.next_token.checked_sub(1).and_then(|number| inputs.tokens.get(number));
    let command =
        process.next_command.checked_sub(1).and_then(|number| inputs.commands.get(number));
    let mut used: Vec<Used> =
        token.map(|token| used_token(token, sample.gate_ns)).into_iter().collect();
    used.extend(command.map(|command| used_command(command, sample.gate_ns)));
    used.push(Used {
        topic: "sample",
        incarnation: sample.incarnation,
        sequence: sample.sequence,
        text: format!("cycle {} of the gate, at {} ns", sample.gate_cycles, sample.gate_ns),
    });
    used
}

/// Hands on the messages of a topic from number `next` on to the last one that was received, if any
/// was, as far as they were published by a time.
fn show_new<T: Message>(
    next: &mut u64,
    (last, history, topic): (Option<u64>, &History<T>, &Topic),
    now_ns: u64,
    mut observe: impl FnMut(&T),
) {
    let Some(last) = last else { return };
    // What is overwritten before it is received was never shown.
    *next = (*next).max((last + 1).saturating_sub(topic.buffer as u64));
    while *next <= last
        && let Some(message) = history.get(*next)
        && message.time_ns() <= now_ns
    {
        observe(message);
        *next += 1;
    }
}

impl Process {
    /// `begins`: from its first sample on. Before it no token can have named this process, so that
    /// the gate was closed in every cycle up to it.
    fn new(config: GateConfig, begins: bool, cycles: u64) -> Self {
        Self {
            config,
            gate: Gate::new(config),
            unknown: (!begins).then_some(NotCompared::BeganBefore),
            cause_known: begins,
            cycles: cycles.saturating_sub(1),
            last_ns: 0,
            output: None,
            next_token: 0,
            next_command: 0,
            shown: false,
        }
    }

    /// The state does not follow from what was seen any more.
    fn forget(&mut self, why: NotCompared) {
        self.unknown.get_or_insert(why);
        self.gate = Gate::new(self.config);
        self.output = None;
        self.cause_known = false;
    }

    /// Which messages the gate was shown up to the cycle of a sample. The newest ones stand in the
    /// sample; `None` where one of them is not in the recording.
    fn received(&self, sample: &Sample, inputs: &Inputs) -> Option<Received> {
        let in_time = |time_ns: u64| time_ns <= sample.gate_ns;
        let known = self.unknown.is_none();
        // A gate of which nothing is known had its newest messages before.
        let from = if known { (self.next_token, self.next_command) } else { (0, 0) };
        let token = inputs.tokens.newest(from.0, |token| {
            token.sequence == sample.token_sequence
                && token.epoch <= sample.epoch
                && in_time(token.time_ns)
        });
        let command = inputs.commands.newest(from.1, |command| {
            command.sequence == sample.command_sequence
                && command.incarnation == sample.command_incarnation
                && in_time(command.time_ns)
        });
        // Without a new one, those that it had are still the newest.
        let (token_stays, command_stays) = match self.output.filter(|_| known) {
            Some(output) => (
                output.token_sequence == sample.token_sequence,
                (output.command_incarnation, output.command_sequence)
                    == (sample.command_incarnation, sample.command_sequence),
            ),
            // Nothing was received so far.
            None => {
                ((sample.epoch, sample.token_sequence) == (0, 0), sample.command_incarnation == 0)
            }
        };
        let found = (token.is_some() || token_stays) && (command.is_some() || command_stays);
        found.then_some(Received { token, command })
    }

    /// Runs the cycle of a sample.
    fn run(&mut self, sample: &Sample, inputs: &Inputs, received: Received, cycle: Cycle) {
        if self.unknown.is_some() {
            // A gate that opens does so for what it was shown last.
            self.gate = Gate::new(self.config);
            self.shown = false;
        }
        let before = self.gate.state();
        if let Cycle::After(unseen) = cycle
            && self.shown
        {
            let span_ns = sample.gate_ns.saturating_sub(self.last_ns);
            // A gate that ran many cycles without a scan keeps its state between them.
            let most = unseen.min(1000);
            for at in 1..=most {
                let before_ns = span_ns / (unseen + 1) * (most + 1 - at);
                let now_ns = sample.gate_ns.saturating_sub(before_ns);
                self.show(inputs, received, now_ns);
                self.gate.step(now_ns);
            }
        }
        self.show(inputs, received, sample.gate_ns);
        let mut output = self.gate.step(sample.gate_ns);
        let refused = sample.gate_cause == GateCause::WriteFailed.code();
        if output.state == GateState::Open && sample.gate_state != GateState::Open.code() && refused
        {
            // That the card refused the volts is an input.
            output = self.gate.write_failed();
        }
        self.cause_known |= before == GateState::Open && output.state != GateState::Open;
        self.output = Some(output);
    }

    /// Shows the gate what it had received by a time.
    fn show(&mut self, inputs: &Inputs, received: Received, now_ns: u64) {
        if !self.shown {
            // What a process received first, nobody knows; only the newest messages count.
            self.next_token = received.token.unwrap_or(self.next_token);
            self.next_command = received.command.unwrap_or(self.next_command);
            self.shown = received.token.is_some() && received.command.is_some();
        }
        let tokens = (received.token, &inputs.tokens, &TOKEN.topic);
        show_new(&mut self.next_token, tokens, now_ns, |token| self.gate.observe_token(token));
        let commands = (received.command, &inputs.commands, &COMMAND.topic);
        show_new(&mut self.next_command, commands, now_ns, |command| {
            self.gate.observe_command(command);
        });
    }

    /// Whether the state follows from what was seen, now that the gate is open: an open gate keeps
    /// nothing of what was before its epoch but the cause why the last one ended.
    fn settles(&mut self, sample: &Sample) -> bool {
        let open = GateState::Open;
        let settles = sample.gate_state == open.code()
            && self
                .output
                .is_some_and(|output| output.state == open && output.epoch == sample.epoch);
        if settles {
            self.unknown = None;
            self.cause_known = false;
        }
        settles
    }
}

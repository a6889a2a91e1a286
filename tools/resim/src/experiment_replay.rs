//! The experiment, run again: each recorded setpoint is computed again by the player from the
//! protocol in the recording's metadata, the sample and the token that the setpoint names, at the
//! time that it names, after as many events of the scanner's line, keys, results of learning and
//! orders as it says to have come.
//!
//! A player is known from the start of a protocol on: it keeps nothing of the one before but where
//! axes rest that are not measured.

use std::collections::BTreeMap;
use std::sync::Arc;

use experiment::cycle::{Received, SCAN_REPORTS_A_CYCLE, Seen};
use experiment::player::{LEASE_NS, Permission, Player, Program};
use experiment::state::PlayerState;
use ipc_types::{EnableToken, Mode, Sample, ScannerPulse, Setpoint};

use crate::difference::first_difference;
use crate::history::Inputs;
use crate::learning_replay::LearningReplay;
use crate::report::{Begin, CoreReport, Difference, NotCompared, Used};
use crate::rigs::Rigs;
use crate::runs::Runs;
use crate::used::{used_sample, used_token};

/// What the player is told, and does not compute.
const GIVEN: [&str; 21] = [
    "session",
    "incarnation",
    "sequence",
    "time_ns",
    "player_ns",
    "sample_tick",
    "sample_time_ns",
    "samples_received",
    "token_incarnation",
    "token_sequence",
    "pulse_incarnation",
    "pulse_sequence",
    "pulses_received",
    "keys_received",
    "results_received",
    "renewed_ns",
    "run_ns",
    "epoch",
    "order",
    "run",
    "continued",
];

/// Latest time that a player can be given: 146 years after the computer's start (ns).
const LATEST_NS: u64 = 1 << 62;

/// A player whose state follows from what was seen.
#[derive(Debug)]
struct Known {
    player: Player,
    learning: LearningReplay,
    /// Numbers of the next sample and of the next event of the line that it has not been given.
    next_sample: u64,
    next_pulse: u64,
}

/// One experiment process.
#[derive(Debug)]
struct Process {
    /// When it published first: it was given the rig file of then [ns, CLOCK_MONOTONIC].
    first_ns: u64,
    /// Sequence number of its next setpoint.
    next: u64,
    /// What it had received at its newest setpoint.
    received: Received,
    /// `Err` where its state does not follow from the messages, and why.
    state: Result<Box<Known>, NotCompared>,
}

/// The messages that a setpoint was computed from.
#[derive(Clone, Copy, Debug)]
struct Named<'a> {
    /// With its number.
    sample: Option<(u64, &'a Sample)>,
    token: Option<&'a EnableToken>,
}

/// The experiment, run again.
#[derive(Debug)]
pub(crate) struct ExperimentReplay {
    pub(crate) report: CoreReport,
    runs: Runs,
    processes: BTreeMap<u64, Process>,
}

impl ExperimentReplay {
    pub(crate) fn new(runs: Runs) -> Self {
        let report = CoreReport::new("experiment", "setpoint");
        Self { report, runs, processes: BTreeMap::new() }
    }

    /// Takes a setpoint that a program of somebody else's published.
    pub(crate) fn skip(&mut self, setpoint: &Setpoint) {
        self.leave_out(setpoint, NotCompared::Replaced);
    }

    fn leave_out(&mut self, setpoint: &Setpoint, why: NotCompared) {
        self.processes.remove(&setpoint.incarnation);
        self.report.messages += 1;
        self.report.skip(why);
    }

    /// Takes a setpoint. Its inputs have been taken before it.
    pub(crate) fn see(&mut self, setpoint: &Setpoint, inputs: &Inputs, rigs: &Rigs) {
        let of_player = setpoint.owner == ipc_types::Process::Experiment.code();
        if !of_player || !(1..=LATEST_NS).contains(&setpoint.player_ns) {
            return self.leave_out(setpoint, NotCompared::NotNamed);
        }
        self.report.messages += 1;
        let process = self
            .processes
            .entry(setpoint.incarnation)
            .or_insert_with(|| Process::new(setpoint.time_ns));
        let begins = process.begins(setpoint);
        let was_known = process.state.is_ok();
        if !begins && setpoint.sequence != process.next {
            process.forget(NotCompared::MessagesMissing);
        }
        let wanted = begins || process.state.is_ok();
        let named = wanted.then(|| Named::find(setpoint, inputs)).flatten();
        if begins {
            process.begin(setpoint, named.as_ref(), &self.runs, rigs);
        }
        let again = process.step(setpoint, named.as_ref(), begins, inputs);
        process.next = setpoint.sequence.saturating_add(1);
        process.received = Received::of(setpoint);
        let at_s = rigs.seconds(setpoint.player_ns);
        let Ok(again) = again.map_err(|why| self.report.skip(why)) else { return };
        if setpoint.sequence == 0 || !was_known {
            let from = if setpoint.sequence == 0 {
                "the first setpoint of the process"
            } else {
                "the start of a protocol"
            };
            self.report.begins.push(Begin { at_s, incarnation: setpoint.incarnation, from });
        }
        let field = first_difference(setpoint, &again, |name| !GIVEN.contains(&name));
        self.report.compare(field, |field| Difference {
            topic: "setpoint",
            incarnation: setpoint.incarnation,
            sequence: setpoint.sequence,
            tick: setpoint.sample_tick,
            at_s,
            field,
            inputs: named.map_or_else(Vec::new, |named| used(&named, setpoint)),
        });
    }
}

impl<'a> Named<'a> {
    /// The sample and the token that a setpoint names; `None` where one is not in the recording.
    fn find(setpoint: &Setpoint, inputs: &'a Inputs) -> Option<Self> {
        let sample = if setpoint.sample_time_ns == 0 {
            None
        } else {
            let number = inputs.samples.newest(0, |sample| {
                sample.tick == setpoint.sample_tick
                    && sample.scan_time_ns == setpoint.sample_time_ns
            })?;
            Some((number, inputs.samples.get(number)?))
        };
        let token = if setpoint.token_incarnation == 0 {
            None
        } else {
            let name = (setpoint.token_incarnation, setpoint.token_sequence);
            Some(inputs.tokens.find(|token| (token.incarnation, token.sequence) == name)?)
        };
        Some(Self { sample, token })
    }

    /// Whether the player knows where each axis is.
    fn measures(&self, axes: u8, now_ns: u64) -> bool {
        let fresh = |sample: &Sample| now_ns.saturating_sub(sample.time_ns) <= LEASE_NS;
        let Some((_, sample)) = self.sample.filter(|(_, sample)| fresh(sample)) else {
            return false;
        };
        let mut axes = sample.master_position.iter().take(usize::from(axes)).enumerate();
        axes.all(|(axis, at)| sample.master_present >> axis & 1 == 1 && at.is_finite())
    }
}

impl Process {
    fn new(first_ns: u64) -> Self {
        Self {
            first_ns,
            next: 0,
            received: Received::default(),
            state: Err(NotCompared::BeganBefore),
        }
    }

    /// Whether a run of a protocol begins with a setpoint.
    fn begins(&self, setpoint: &Setpoint) -> bool {
        let follows = setpoint.sequence == self.next;
        setpoint.sequence == 0 || follows && setpoint.run != self.received.run
    }

    /// The state does not follow from what was seen any more. Where it did not before, the first
    /// reason stays.
    fn forget(&mut self, why: NotCompared) {
        if self.state.is_ok() {
            self.state = Err(why);
        }
    }

    /// Begins the run of a protocol.
    fn begin(&mut self, setpoint: &Setpoint, named: Option<&Named<'_>>, runs: &Runs, rigs: &Rigs) {
        let now_ns = setpoint.player_ns;
        let measured = named.is_some_and(|named| named.measures(setpoint.axes, now_ns));
        let known = match std::mem::replace(&mut self.state, Err(NotCompared::InputMissing)) {
            // The first run of a process, or one that brings all that counts.
            Err(_) if setpoint.sequence == 0 || measured => Box::new(Known::new()),
            Ok(known) => known,
            Err(why) => {
                self.state = Err(why);
                return;
            }
        };
        let rig = rigs.at(self.first_ns).ok_or(NotCompared::ProtocolMissing);
        let program = rig.and_then(|rig| runs.program(setpoint, rig));
        self.state = program.map(|program| {
            let mut known = known;
            known.begin(setpoint, program);
            known
        });
    }

    /// Computes a setpoint again.
    fn step(
        &mut self,
        setpoint: &Setpoint,
        named: Option<&Named<'_>>,
        begins: bool,
        inputs: &Inputs,
    ) -> Result<Setpoint, NotCompared> {
        if named.is_none() {
            self.forget(NotCompared::InputMissing);
        }
        let known = self.state.as_mut().map_err(|why| *why)?;
        let named = named.ok_or(NotCompared::InputMissing)?;
        let given = known.give(&self.received, setpoint, (named, begins), inputs);
        let again = given.map(|()| known.step(setpoint, named));
        // What the player asked to be done may be beyond what is known, from the next step on.
        let done = known.learning.work(&mut known.player);
        if let Err(why) = given.and(done) {
            self.forget(why);
        }
        again
    }
}

impl Known {
    fn new() -> Self {
        Self {
            player: Player::default(),
            learning: LearningReplay::default(),
            next_sample: 0,
            next_pulse: 0,
        }
    }

    /// Has the player play a program.
    fn begin(&mut self, setpoint: &Setpoint, program: Arc<Program>) {
        let (player, epoch) = (&mut self.player, setpoint.epoch);
        if setpoint.run == 0 {
            let begun = program.state(setpoint.session, epoch, 0);
            let state = PlayerState { segment: setpoint.segment, running: true, ..begun };
            // A segment that the protocol does not have shows in the setpoint.
            let _resumed = player.resume(&state, program);
        } else {
            Received::default().play(setpoint.run, program, epoch, player);
        }
        // Its cycles before the first setpoint brought nothing but the time of the first of them.
        player.supervise(setpoint.run_ns, Permission::Enabled(epoch), setpoint.run_ns);
    }

    /// Gives the player what has come since the setpoint before; `begins` where a run begins.
    fn give(
        &mut self,
        before: &Received,
        setpoint: &Setpoint,
        (named, begins): (&Named<'_>, bool),
        inputs: &Inputs,
    ) -> Result<(), NotCompared> {
        let (mut received, now) = (*before, Received::of(setpoint));
        let next_sample = named.sample.map_or(self.next_sample, |(number, _)| number + 1);
        if self.learning.is_active() && !begins {
            let came = now.samples.checked_sub(before.samples);
            if came != next_sample.checked_sub(self.next_sample) {
                return Err(NotCompared::InputMissing);
            }
            for number in self.next_sample..next_sample {
                let sample = inputs.samples.get(number).filter(|it| it.scan_time_ns <= LATEST_NS);
                received.sample(sample.ok_or(NotCompared::InputMissing)?, &mut self.player);
            }
        }
        self.next_sample = next_sample;
        self.give_scanner(&mut received, setpoint, begins, inputs)?;
        for _ in before.results..now.results {
            match self.learning.result() {
                Some(result) => received.result(result, &mut self.player),
                // One of a run before, of which nothing is known.
                None if begins => break,
                None => return Err(NotCompared::LearntBefore),
            }
        }
        let stops = if begins { now.order != now.run } else { now.order != before.order };
        if stops {
            received.stop(now.order, &mut self.player);
        }
        Ok(())
    }

    /// Gives the player what the scanner has sent.
    fn give_scanner(
        &mut self,
        received: &mut Received,
        setpoint: &Setpoint,
        begins: bool,
        inputs: &Inputs,
    ) -> Result<(), NotCompared> {
        let (before, now) = (*received, Received::of(setpoint));
        let newest = inputs.pulses.newest(self.next_pulse, |pulse| {
            (pulse.incarnation, pulse.sequence) == (now.pulse_incarnation, now.pulse_sequence)
        });
        let from = self.next_pulse;
        self.next_pulse = newest.map_or(from, |newest| newest + 1);
        let program = self.player.program();
        let program = program.filter(|program| program.keeps_to_scanner() && !begins);
        // Before its first step the player counts nothing.
        let Some(program) = program else { return Ok(()) };
        if program.takes_keys() {
            for count in before.keys..now.keys {
                let name = (setpoint.incarnation, count + 1);
                let key = inputs.keys.find(|key| (key.incarnation, key.pulses) == name);
                let key = key.filter(|key| key.at_ns <= LATEST_NS);
                received.key(key.ok_or(NotCompared::InputMissing)?.at_ns, &mut self.player);
            }
        } else if program.needs_trigger() {
            self.give_pulses(received, &now, from, inputs)?;
        }
        Ok(())
    }

    /// Gives the player the events of the scanner's line up to the newest that it knew, from
    /// number `from` of the recording on.
    fn give_pulses(
        &mut self,
        received: &mut Received,
        now: &Received,
        from: u64,
        inputs: &Inputs,
    ) -> Result<(), NotCompared> {
        let next = self.next_pulse;
        let came = now.pulses.checked_sub(received.pulses).ok_or(NotCompared::InputMissing)?;
        // Before its first event a process has no place among those of the recording, of which it
        // may not have got the oldest.
        let first = received.pulses == 0;
        let from = if first { next.saturating_sub(came) } else { from };
        if next.checked_sub(from) != Some(came) {
            return Err(NotCompared::InputMissing);
        }
        for number in from..next {
            let is_sound = |pulse: &&ScannerPulse| {
                let behind = now.pulse_sequence.checked_sub(pulse.sequence);
                let of_sender =
                    pulse.incarnation == now.pulse_incarnation && behind == Some(next - 1 - number);
                pulse.at_ns <= LATEST_NS && (!first || of_sender)
            };
            let pulse = inputs.pulses.get(number).filter(is_sound);
            received.pulse(pulse.ok_or(NotCompared::InputMissing)?, &mut self.player);
        }
        Ok(())
    }

    /// Runs the player's cycle; a message of zeros where none is due.
    fn step(&mut self, setpoint: &Setpoint, named: &Named<'_>) -> Setpoint {
        let seen = Seen {
            sample: named.sample.map(|(_, sample)| sample),
            token: named.token,
            renewed_ns: setpoint.renewed_ns,
            received: Received::of(setpoint),
        };
        let output = seen.step(&mut self.player, setpoint.player_ns);
        let _notice = self.player.take_notice();
        for _ in 0..SCAN_REPORTS_A_CYCLE {
            if self.player.take_scan_report().is_none() {
                break;
            }
        }
        output.and_then(|output| output.setpoint).unwrap_or_default()
    }
}

/// What a setpoint was computed from, in words.
fn used(named: &Named<'_>, setpoint: &Setpoint) -> Vec<Used> {
    let now_ns = setpoint.player_ns;
    let sample = named.sample.map(|(_, sample)| used_sample(sample, now_ns));
    let mut used: Vec<Used> = sample.into_iter().collect();
    used.extend(named.token.map(|token| used_token(token, now_ns)));
    let mode = Mode::from_code(setpoint.mode).map_or("unknown", Mode::text);
    let renewed_ms = (now_ns as f64 - setpoint.renewed_ns as f64) * 1e-6;
    used.push(Used {
        topic: "setpoint",
        incarnation: setpoint.incarnation,
        sequence: setpoint.sequence,
        text: format!(
            "computed at {now_ns} ns, mode {mode}, protocol {:016x}, segment {} of {}, order {}, \
             run {} in epoch {}, lease renewed {renewed_ms:.3} ms before, received: {} samples, {} \
             events of the scanner's line, {} keys, {} results of learning",
            setpoint.protocol,
            setpoint.segment,
            setpoint.segments,
            setpoint.order,
            setpoint.run,
            setpoint.epoch,
            setpoint.samples_received,
            setpoint.pulses_received,
            setpoint.keys_received,
            setpoint.results_received,
        ),
    });
    used
}

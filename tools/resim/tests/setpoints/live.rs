//! An experiment process without its ports, and what a recording has of it.

use std::collections::VecDeque;
use std::sync::Arc;

use experiment::cycle::{Received, SCAN_REPORTS_A_CYCLE, Seen};
use experiment::ilc_trial::{IlcResult, Returned};
use experiment::ilc_update::IlcUpdater;
use experiment::player::{IlcJob, Player, Program};
use experiment::state::PlayerState;
use ipc_types::{
    EnableToken, GateState, LineEvent, Profile, PulseSource, Sample, ScannerPulse, Setpoint,
    WatchdogState,
};
use resim::{CoreReport, Recorded, Replay, Rigs, Runs};
use rig::RigFile;
use rig::protocol::Protocol;

const RIG: &str = include_str!("../../../../launch/rigs/hydrostatic.toml");
/// Of a computer that has run for hours.
const START_NS: u64 = 10_000_000_000_000;
pub const CYCLE_NS: u64 = 2_000_000;
const SCAN_NS: u64 = 500_000;
pub const SECOND: usize = 500;
const ACQUISITION: u64 = 2;
const WATCHDOG: u64 = 3;
/// The first experiment process; its successors count on.
pub const EXPERIMENT: u64 = 4;
/// Cycles that the thread takes that learns.
const LEARNING: usize = 3;

/// A message, as a recording has it.
#[derive(Clone, Debug)]
pub enum Message {
    Sample(Box<Sample>),
    Token(Box<EnableToken>),
    Setpoint(Box<Setpoint>),
    Pulse(ScannerPulse),
    Key(ScannerPulse),
}

/// The process, and what is around it.
pub struct Live {
    rig: RigFile,
    pub player: Player,
    received: Received,
    incarnation: u64,
    now_ns: u64,
    /// Numbers of the next sample, token, setpoint and pulse.
    sequences: [u64; 4],
    /// Enable epoch; 0 after a trip.
    pub epoch: u64,
    /// Whether the client renews its lease.
    pub client: bool,
    renewed_ns: u64,
    /// Whether samples come.
    pub samples: bool,
    newest: Option<Sample>,
    token: Option<EnableToken>,
    order: Option<Arc<Program>>,
    stop: bool,
    pulse: bool,
    key: bool,
    /// Positions of the handle, the newest first.
    path: VecDeque<f64>,
    updater: Option<IlcUpdater>,
    /// What the thread that learns will have done, with the cycles until then.
    results: VecDeque<(usize, IlcResult)>,
    pub recorded: Vec<Message>,
    pub runs: Runs,
}

pub fn rig() -> RigFile {
    RigFile::parse(RIG, "rig.toml").unwrap()
}

impl Live {
    pub fn new() -> Self {
        Self {
            rig: rig(),
            player: Player::default(),
            received: Received::default(),
            incarnation: EXPERIMENT,
            now_ns: START_NS,
            sequences: [0; 4],
            epoch: 70,
            client: true,
            renewed_ns: 0,
            samples: true,
            newest: None,
            token: None,
            order: None,
            stop: false,
            pulse: false,
            key: false,
            path: VecDeque::from([0.05; 16]),
            updater: None,
            results: VecDeque::new(),
            recorded: Vec::new(),
            runs: Runs::default(),
        }
    }

    fn program(&self, text: &str, pulses: &str) -> Program {
        let protocol = Protocol::parse(text, "test.toml").unwrap();
        let program = Program::new(&protocol, &self.rig).unwrap();
        program.with_pulses(&pulses.parse().unwrap()).unwrap()
    }

    /// Has a protocol played with the next cycle; `pulses` as in `scanner_pulses` of the metadata.
    pub fn play(&mut self, text: &str, pulses: &str) {
        let source: PulseSource = pulses.parse().unwrap();
        self.runs.push(self.now_ns, text.to_owned(), source);
        self.order = Some(Arc::new(self.program(text, pulses)));
    }

    /// Asks for a stop.
    pub fn stop(&mut self) {
        self.stop = true;
    }

    /// The scanner sends a pulse.
    pub fn pulse(&mut self) {
        self.pulse = true;
    }

    /// The key 5 is typed.
    pub fn key(&mut self) {
        self.key = true;
    }

    /// A successor of the process goes on with the protocol.
    pub fn restart(&mut self, text: &str, pulses: &str) {
        let program = self.program(text, pulses);
        let segment = self.player.status().segment;
        let state = PlayerState { segment, running: true, ..program.state(1, self.epoch, 9) };
        (self.player, self.received) = (Player::default(), Received::default());
        self.player.resume(&state, Arc::new(program)).unwrap();
        self.incarnation += 1;
        self.sequences[2] = 0;
        (self.renewed_ns, self.token, self.newest) = (0, None, None);
        (self.updater, self.results) = (None, VecDeque::new());
    }

    fn next(&mut self, topic: usize) -> u64 {
        self.sequences[topic] += 1;
        self.sequences[topic] - 1
    }

    pub fn run(&mut self, cycles: usize) {
        for _ in 0..cycles {
            self.cycle();
        }
    }

    fn cycle(&mut self) {
        self.acquisition();
        self.watchdog();
        for (after, _) in &mut self.results {
            *after = after.saturating_sub(1);
        }
        while let Some((0, _)) = self.results.front()
            && let Some((_, result)) = self.results.pop_front()
        {
            self.received.result(result, &mut self.player);
        }
        let woke_ns = self.now_ns + 1_700_000;
        if let Some(program) = self.order.take() {
            let epoch = self.token.map_or(0, |token| token.epoch);
            self.received.play(self.received.order + 1, program, epoch, &mut self.player);
            self.renewed_ns = woke_ns;
        }
        if std::mem::take(&mut self.stop) {
            self.received.stop(self.received.order + 1, &mut self.player);
        }
        let (newest, token) = (self.newest, self.token);
        let seen = Seen {
            sample: newest.as_ref(),
            token: token.as_ref(),
            renewed_ns: self.renewed_ns,
            received: self.received,
        };
        let output = seen.step(&mut self.player, woke_ns);
        if let Some(setpoint) = output.and_then(|output| output.setpoint) {
            self.path.rotate_right(1);
            self.path[0] = setpoint.position[0];
            let identity = (self.next(2), woke_ns + 20_000);
            self.recorded.push(Message::Setpoint(Box::new(Setpoint {
                session: 1,
                incarnation: self.incarnation,
                sequence: identity.0,
                time_ns: identity.1,
                ..setpoint
            })));
        }
        for _ in 0..SCAN_REPORTS_A_CYCLE {
            let _report = self.player.take_scan_report();
        }
        self.learn();
        // The lease is renewed between two cycles.
        if self.client && (self.now_ns / CYCLE_NS).is_multiple_of(10) {
            self.renewed_ns = woke_ns + 100_000;
        }
        self.now_ns += CYCLE_NS;
    }

    /// The samples since the cycle before, and the scanner.
    fn acquisition(&mut self) {
        for scan in 0..4 {
            let scan_time_ns = self.now_ns + scan * SCAN_NS;
            if !self.samples {
                continue;
            }
            let open = if self.epoch > 0 { GateState::Open } else { GateState::ALL[0] };
            let mut sample = Sample {
                session: 1,
                incarnation: ACQUISITION,
                sequence: self.next(0),
                time_ns: scan_time_ns + 80_000,
                tick: scan_time_ns / SCAN_NS,
                scan_time_ns,
                axes: 1,
                master_present: 1,
                slave_present: 1,
                homed: 1,
                homing_sequence: 1,
                gate_state: open.code(),
                ..Sample::default()
            };
            // It lags, and comes short of it.
            sample.master_position[0] = self.path[1] + 1e-4 * scan as f64;
            sample.slave_position[0] = 0.8 * self.path[14];
            self.recorded.push(Message::Sample(Box::new(sample)));
            self.received.sample(&sample, &mut self.player);
            self.newest = Some(sample);
        }
        let at_ns = self.now_ns + 1_600_000;
        let pulse = ScannerPulse {
            session: 1,
            time_ns: at_ns + 10_000,
            at_ns,
            kind: LineEvent::Pulse.code(),
            ..ScannerPulse::default()
        };
        if std::mem::take(&mut self.pulse) {
            let (incarnation, sequence) = (ACQUISITION, self.next(3));
            let pulse = ScannerPulse { incarnation, sequence, ..pulse };
            self.recorded.push(Message::Pulse(pulse));
            self.received.pulse(&pulse, &mut self.player);
        }
        if std::mem::take(&mut self.key) {
            self.received.key(at_ns, &mut self.player);
            let (incarnation, pulses) = (self.incarnation, self.received.keys);
            self.recorded.push(Message::Key(ScannerPulse { incarnation, pulses, ..pulse }));
        }
    }

    fn watchdog(&mut self) {
        let state = if self.epoch > 0 { WatchdogState::Enabled } else { WatchdogState::Tripped };
        let token = EnableToken {
            session: 1,
            incarnation: WATCHDOG,
            sequence: self.next(1),
            time_ns: self.now_ns + 1_650_000,
            epoch: self.epoch,
            state: state.code(),
            ..EnableToken::default()
        };
        self.recorded.push(Message::Token(Box::new(token)));
        self.token = Some(token);
    }

    /// The thread that learns.
    fn learn(&mut self) {
        while let Some(job) = self.player.job() {
            let result = match job {
                IlcJob::Begin { run_id, program, segment, .. } => {
                    let plan = program.plan(segment as usize).unwrap().as_ref().clone();
                    let made = IlcUpdater::new(plan, segment, None, None).unwrap();
                    self.updater.insert(made).ready(run_id)
                }
                IlcJob::Returned(Returned::Record(record)) => {
                    let Some(updater) = &mut self.updater else { continue };
                    let updated = updater.update(&record);
                    assert!(!updated.failed);
                    IlcResult::updated(record, updated.reference)
                }
                IlcJob::Returned(Returned::Reference(_)) => continue,
                IlcJob::End(_) => {
                    self.updater = None;
                    continue;
                }
            };
            self.results.push_back((LEARNING, result));
        }
    }

    /// The experiment, run again on what was recorded.
    pub fn again(&self) -> CoreReport {
        again(&self.recorded, self.runs.clone())
    }

    pub fn setpoints(&self) -> impl Iterator<Item = &Setpoint> {
        self.recorded.iter().filter_map(|message| match message {
            Message::Setpoint(setpoint) => Some(setpoint.as_ref()),
            _ => None,
        })
    }
}

/// The experiment, run again on a recording.
pub fn again(recorded: &[Message], runs: Runs) -> CoreReport {
    let rigs = Rigs::new(rig(), Profile::BestEffort, START_NS);
    let mut replay = Replay::new(rigs, runs, None, Vec::new()).unwrap();
    for message in recorded {
        replay.take(match message {
            Message::Sample(sample) => Recorded::Sample(sample),
            Message::Token(token) => Recorded::Token(token),
            Message::Setpoint(setpoint) => Recorded::Setpoint(setpoint),
            Message::Pulse(pulse) => Recorded::Pulse(pulse),
            Message::Key(key) => Recorded::Key(key),
        });
    }
    let mut cores = replay.report().cores;
    cores.pop().unwrap()
}

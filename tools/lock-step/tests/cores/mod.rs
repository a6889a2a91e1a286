//! The pure cores of every process of a rig, each called when its grid says so; a message is seen
//! by whoever looks after it was sent, as through shared memory. Nothing sleeps and nothing is
//! shared.
#![allow(dead_code, unreachable_pub)]

use std::sync::Arc;

use acquisition::Converter;
use acquisition::homing::Homing;
use control::cycle::Seen;
use control::law::{Law, LawConfig};
use control::setpoint_validation::SetpointValidation;
use experiment::player::{Change, Player, Program};
use ipc_types::program_flow::{ACQUISITION_CYCLE, CONTROL_CYCLE, signature};
use ipc_types::{
    AXES, EnableLine, EnableToken, HomeOrder, MotorCommand, Profile, Sample, Setpoint, Verb,
    WatchdogState,
};
use rig::RigFile;
use rig::protocol::Protocol;
use runtime::Timeouts;
use runtime::daq::{Present, Scan};
use runtime::gate::{Gate, GateConfig};
use simulator::Card;
use simulator::faults::{Fault, FaultInjector};
use watchdog::interlock::{Config, Interlock, Peers};

/// A protocol that moves the handle for longer than any test looks.
pub const MOVEMENT: &str = r#"[protocol]
name = "to and fro"

[[segments]]
kind = "guided_sine"
amplitude_deg = 25.0
frequency_hz = 1.0
duration_s = 60.0
fade_in_s = 0.8
"#;

/// Card ticks in a second.
pub const SECOND: u64 = 2000;

pub const SESSION: u64 = 7;
pub const ACQUISITION: u64 = 11;
pub const CONTROL: u64 = 12;
pub const WATCHDOG: u64 = 13;
pub const EXPERIMENT: u64 = 14;
/// The profile of a rig, unless a test wants another.
pub const PROFILE: Profile = Profile::Realtime;

/// One cycle of control as it was: what it saw, and what it answered.
pub struct Cycle {
    pub sample: Sample,
    pub setpoint: Option<Setpoint>,
    pub powered: bool,
    pub command: MotorCommand,
}

/// A message that was published, as a recording has it.
#[derive(Clone, Debug)]
pub enum Published {
    Sample(Box<Sample>),
    Setpoint(Box<Setpoint>),
    Command(Box<MotorCommand>),
    Token(Box<EnableToken>),
    Line(EnableLine),
}

/// The processes of one rig, without what is between them.
pub struct Rig {
    profile: Profile,
    pub card: Card,
    pub homing: Homing,
    orders: Vec<HomeOrder>,
    converter: Converter,
    pub gate: Gate,
    law: Law,
    pub machine: Interlock,
    pub player: Player,
    program: Arc<Program>,
    validation: SetpointValidation,
    /// Changes of the player's state.
    pub changes: Vec<Change>,
    /// A trip of the watchdog ends the test, unless it is what the test wants.
    pub may_trip: bool,
    present: Present,
    /// What was sent last, by topic; a list where the receiver takes every message.
    scans: Vec<Scan>,
    output: Option<[f64; AXES]>,
    lines: Vec<(u64, u64)>,
    toggles: u64,
    tokens: Vec<EnableToken>,
    newest_token: Option<EnableToken>,
    commands: Vec<MotorCommand>,
    watched_commands: Vec<MotorCommand>,
    watched_samples: Vec<Sample>,
    played_samples: Vec<Sample>,
    pub newest_sample: Option<Sample>,
    setpoint: Option<Setpoint>,
    sent: Option<Setpoint>,
    /// Numbers of the next sample, command and setpoint.
    sequences: [u64; 3],
    /// Samples and commands that the watchdog has received.
    received: [u64; 2],
    /// What the experiment has received.
    taken: experiment::cycle::Received,
    /// Whether the protocol is played again, once the motor is enabled anew.
    pub play_again: bool,
    /// Incarnation of control, which does not run while it is stopped.
    pub control: u64,
    pub control_stopped: bool,
    /// All that was published, in the order of time, where it is wanted.
    pub published: Option<Vec<Published>>,
    pub cycles: Vec<Cycle>,
}

impl Rig {
    pub fn new(rig: &RigFile, protocol: &str) -> Self {
        Self::of_profile(rig, protocol, PROFILE)
    }

    pub fn of_profile(rig: &RigFile, protocol: &str, profile: Profile) -> Self {
        let protocol = Protocol::parse(protocol, "protocol.toml").unwrap();
        let volts_max = |axis: usize| rig.axes.get(axis).map_or(0.0, |axis| axis.limits.volts_max);
        let bits = (1u8 << rig.axes.len()) - 1;
        Self {
            profile,
            card: Card::new(rig, &[], Timeouts::of(profile).enable_line_ns).unwrap(),
            homing: Homing::absolute(rig),
            orders: Vec::new(),
            converter: Converter::new(rig),
            gate: Gate::new(GateConfig::for_profile(
                profile,
                SESSION,
                ACQUISITION,
                rig.axes.len(),
                std::array::from_fn(volts_max),
            )),
            law: Law::new(LawConfig::of_rig(rig)),
            machine: Interlock::new(Config::for_profile(profile, SESSION, WATCHDOG, rig)),
            player: Player::default(),
            program: Arc::new(Program::new(&protocol, rig).unwrap()),
            validation: SetpointValidation::of_rig(SESSION, rig),
            changes: Vec::new(),
            may_trip: false,
            present: Present { master: bits, slave: bits, motor: bits, analog: rig.channel_bits() },
            scans: Vec::new(),
            output: None,
            lines: Vec::new(),
            toggles: 0,
            tokens: Vec::new(),
            newest_token: None,
            commands: Vec::new(),
            watched_commands: Vec::new(),
            watched_samples: Vec::new(),
            played_samples: Vec::new(),
            newest_sample: None,
            setpoint: None,
            sent: None,
            sequences: [0; 3],
            received: [0; 2],
            taken: experiment::cycle::Received::default(),
            play_again: false,
            control: CONTROL,
            control_stopped: false,
            published: None,
            cycles: Vec::new(),
        }
    }

    /// Starts control again, as a new process.
    pub fn restart_control(&mut self, rig: &RigFile) {
        self.law = Law::new(LawConfig::of_rig(rig));
        self.validation = SetpointValidation::of_rig(SESSION, rig);
        self.setpoint = None;
        self.control += 100;
        self.sequences[1] = 0;
        self.control_stopped = false;
    }

    fn publish(&mut self, message: Published) {
        if let Some(published) = &mut self.published {
            published.push(message);
        }
    }

    fn next(&mut self, topic: usize) -> u64 {
        self.sequences[topic] += 1;
        self.sequences[topic] - 1
    }

    /// Puts a fault into card or machine, from the next scan on.
    pub fn begin_fault(&mut self, text: &str, rig: &RigFile) {
        let fault = Fault::parse(text, None, None, rig).unwrap();
        let (injection, plant) = FaultInjector::new(rig, &[]).prepare(&fault).unwrap();
        assert!(self.card.begin_fault(&injection, plant).0);
    }

    pub fn simulator(&mut self, tick: u64, now: u64) {
        for (toggles, time_ns) in self.lines.drain(..) {
            self.card.enable_line(1, toggles, time_ns);
        }
        if let Some(volts) = self.output.take() {
            self.card.write(volts, 0, ACQUISITION);
        }
        let scan = self.card.clock(tick, now);
        if !self.card.scan_is_lost() {
            self.scans.push(Scan::of_card(&scan, self.present));
        }
    }

    pub fn acquisition(&mut self, now: u64) {
        for token in self.tokens.drain(..) {
            self.gate.observe_token(&token);
        }
        for command in self.commands.drain(..) {
            self.gate.observe_command(&command);
        }
        let output = self.gate.step(now);
        self.output = Some(output.volts);
        for order in self.orders.drain(..) {
            let _repeated = self.homing.order(&order);
        }
        for scan in std::mem::take(&mut self.scans) {
            self.homing.observe(&scan);
            let sample = Sample {
                session: SESSION,
                incarnation: ACQUISITION,
                sequence: self.next(0),
                time_ns: now,
                output_v: output.volts,
                epoch: output.epoch,
                token_sequence: output.token_sequence,
                flow: signature(ACQUISITION_CYCLE, output.token_sequence),
                command_incarnation: output.command_incarnation,
                command_sequence: output.command_sequence,
                gate_state: output.state.code(),
                gate_cause: output.cause.code(),
                gate_ns: output.now_ns,
                gate_cycles: output.cycles,
                backend: ipc_types::CardKind::Simulated.code(),
                profile: self.profile.code(),
                ..self.converter.convert(&scan, self.homing.zeros())
            };
            self.publish(Published::Sample(Box::new(sample)));
            self.watched_samples.push(sample);
            self.played_samples.push(sample);
            self.newest_sample = Some(sample);
        }
    }

    pub fn control(&mut self, now: u64) {
        let Some(sample) = self.newest_sample.filter(|_| !self.control_stopped) else { return };
        self.validation.see(&sample);
        if let Some(next) = self.sent.take()
            && self.validation.validate(now, &next).is_ok()
        {
            self.setpoint = Some(next);
        }
        let seen = Seen {
            sample: &sample,
            setpoint: self.setpoint.as_ref(),
            token: self.newest_token.as_ref(),
            incarnation: self.control,
        };
        let command = seen.step(&mut self.law, now);
        let powered = seen.powered();
        self.cycles.push(Cycle { sample, setpoint: self.setpoint, powered, command });
        let command = MotorCommand {
            session: SESSION,
            incarnation: self.control,
            sequence: self.next(1),
            time_ns: now,
            flow: signature(CONTROL_CYCLE, command.token_sequence),
            profile: self.profile.code(),
            ..command
        };
        self.publish(Published::Command(Box::new(command)));
        self.commands.push(command);
        self.watched_commands.push(command);
    }

    pub fn watchdog(&mut self, now: u64) {
        self.received[0] += self.watched_samples.len() as u64;
        self.received[1] += self.watched_commands.len() as u64;
        for sample in self.watched_samples.drain(..) {
            self.machine.observe_sample(&sample);
        }
        for command in self.watched_commands.drain(..) {
            self.machine.observe_command(&command);
        }
        // A person who asks until it is done.
        let verb = match self.machine.state() {
            WatchdogState::Faulted | WatchdogState::Tripped => Some(Verb::Reset),
            WatchdogState::Disarmed => Some(Verb::Arm),
            WatchdogState::Armed => Some(Verb::Enable),
            WatchdogState::Enabled => None,
        };
        let tripped = self.machine.state() == WatchdogState::Tripped;
        assert!(!tripped || self.may_trip, "{:?}", self.machine.cause());
        // A person who asks again once control is back.
        let asked = verb.filter(|_| !tripped || self.control != CONTROL);
        let executed = asked.filter(|verb| self.machine.command(*verb, now).is_ok());
        let outputs = self.machine.step(now, Peers::ALIVE);
        // The machine counts its tokens itself, and the publisher stamps the same number.
        let token = EnableToken {
            session: SESSION,
            incarnation: WATCHDOG,
            time_ns: now,
            verb: Verb::executed_code(executed),
            samples_received: self.received[0],
            commands_received: self.received[1],
            ..outputs.token
        };
        self.publish(Published::Token(Box::new(token)));
        self.tokens.push(token);
        self.newest_token = Some(token);
        self.toggles += u64::from(outputs.toggle_line);
        self.publish(Published::Line(EnableLine {
            session: SESSION,
            incarnation: WATCHDOG,
            sequence: token.sequence,
            time_ns: now,
            epoch: token.epoch,
            toggles: self.toggles,
        }));
        self.lines.push((self.toggles, now));
    }

    pub fn experiment(&mut self, now: u64, begin: bool) {
        for sample in self.played_samples.drain(..) {
            self.taken.sample(&sample, &mut self.player);
        }
        let token = self.newest_token;
        let may_begin = token.is_some_and(|token| {
            token.state == WatchdogState::Enabled.code() && token.epoch > self.player.epoch()
        });
        let again = self.play_again && may_begin;
        self.play_again &= !again;
        if begin || again {
            let (number, program) = (self.taken.order + 1, Arc::clone(&self.program));
            let epoch = token.map_or(0, |token| token.epoch);
            self.taken.play(number, program, epoch, &mut self.player);
        }
        let seen = experiment::cycle::Seen {
            sample: self.newest_sample.as_ref(),
            token: token.as_ref(),
            // A client that is always there.
            renewed_ns: now,
            received: self.taken,
        };
        let Some(output) = seen.step(&mut self.player, now) else { return };
        self.orders.extend(self.player.home_order());
        self.changes.extend(output.change);
        if let Some(setpoint) = output.setpoint {
            let sequence = self.next(2);
            let setpoint = Setpoint {
                session: SESSION,
                incarnation: EXPERIMENT,
                sequence,
                time_ns: now,
                ..setpoint
            };
            self.publish(Published::Setpoint(Box::new(setpoint)));
            self.sent = Some(setpoint);
        }
    }
}

/// Periods of the card that pass before control starts: the lock-step rig's control sees the third
/// scan first.
pub const BEFORE_CONTROL: u64 = 2;
/// Periods of the card from its first scan to the start of the protocol: power comes before.
const BEFORE_PROTOCOL: u64 = 400;

/// The time grid of a rig: which process runs when.
pub struct Timeline {
    rates: rig::Rates,
    phases: rig::Phases,
    /// Tick of the first scan.
    pub first: u64,
    begun: bool,
}

impl Timeline {
    pub fn new(rig: &RigFile) -> Self {
        let ratio = rig.rates.control_period_ns() / rig.rates.acquisition_period_ns();
        // A clock that has been running for hours, and a card that comes up so that control's grid
        // hits its third scan.
        let hours = (20_000_000 / 12) * 12;
        let first = hours - hours % ratio + 12 * ratio - BEFORE_CONTROL;
        Self { rates: rig.rates, phases: rig.phases, first, begun: false }
    }

    /// All that happens within one period of the card, in the order of the phases; on a wrap, in
    /// the next one.
    pub fn run(&mut self, live: &mut Rig, tick: u64) {
        let card = self.rates.acquisition_period_ns();
        let start = tick * card;
        let mut due: Vec<(u64, u8)> =
            vec![(self.phases.simulator_ns, 0), (self.phases.acquisition_ns, 1)];
        for (period, phase, who) in [
            (self.rates.control_period_ns(), self.phases.control_ns, 2),
            (self.rates.watchdog_period_ns(), self.phases.watchdog_ns, 3),
            (self.rates.experiment_period_ns(), self.phases.experiment_ns, 4),
        ] {
            // A loop that is faster than the card wakes several times.
            let after = (phase + period - start % period) % period;
            due.extend((after..card).step_by(period as usize).map(|after| (after, who)));
        }
        due.sort_unstable();
        for (after, who) in due {
            let now = start + after;
            match who {
                0 => live.simulator(tick, now),
                1 => live.acquisition(now),
                2 if tick >= self.first + BEFORE_CONTROL => live.control(now),
                2 => {}
                3 => live.watchdog(now),
                _ => {
                    let begin = !self.begun && tick > self.first + BEFORE_PROTOCOL;
                    self.begun |= begin;
                    live.experiment(now, begin);
                }
            }
        }
    }
}

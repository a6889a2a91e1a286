//! The processes' cores on the time grid of a rig, against the lock-step rig: sample by sample, bit
//! for bit.
//!
//! Every process of the live rig has its pure core here (card, converter and gate, law, watchdog's
//! machine, protocol's player), each called when its grid says so, in the order of the phases; a
//! message is seen by whoever looks after it was sent, as through shared memory. Nothing sleeps and
//! nothing is shared: this is the live rig whose clock is never late. The lock-step rig then gets
//! the setpoints that control saw, with the times moved to its own clock.
//!
//! What is equal: every scan that control answers (encoder counts, analog inputs with their noise,
//! volts at the motors), and every command, from the first scan on, before power and after. What is
//! not: whether the motor has power before anybody enabled it, for the lock-step rig's enable line
//! toggles by itself (at 0 V that moves nothing; a hand of kind "moving" would set off earlier),
//! and identities, sequences and times.
#![allow(clippy::unwrap_used)]

use std::sync::Arc;

use acquisition::Converter;
use control::law::{Law, LawConfig};
use experiment::player::{Player, Program};
use ipc_types::{
    AXES, EnableToken, GateState, MotorCommand, Profile, Sample, Setpoint, Verb, WatchdogState,
};
use lock_step::LockStepRig;
use rig::RigFile;
use rig::protocol::Protocol;
use runtime::Timeouts;
use runtime::daq::{Present, Scan};
use runtime::gate::{Gate, GateConfig};
use simulator::Card;
use watchdog::interlock::{Config, Interlock, Peers};

const SESSION: u64 = 7;
const ACQUISITION: u64 = 11;
const CONTROL: u64 = 12;
const WATCHDOG: u64 = 13;
const EXPERIMENT: u64 = 14;
const PROFILE: Profile = Profile::Realtime;

/// One cycle of control as it was: what it saw, and what it answered.
struct Cycle {
    sample: Sample,
    setpoint: Option<Setpoint>,
    powered: bool,
    command: MotorCommand,
}

/// The processes of one rig, without what is between them.
struct Rig {
    card: Card,
    converter: Converter,
    gate: Gate,
    law: Law,
    machine: Interlock,
    player: Player,
    program: Arc<Program>,
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
    newest_sample: Option<Sample>,
    setpoint: Option<Setpoint>,
    /// Numbers of the next sample, command and setpoint.
    sequences: [u64; 3],
    cycles: Vec<Cycle>,
}

impl Rig {
    fn new(rig: &RigFile, protocol: &str) -> Self {
        let protocol = Protocol::parse(protocol, "protocol.toml").unwrap();
        let volts_max = |axis: usize| rig.axes.get(axis).map_or(0.0, |axis| axis.limits.volts_max);
        let bits = (1u8 << rig.axes.len()) - 1;
        Self {
            card: Card::new(rig, &[], Timeouts::of(PROFILE).enable_line_ns).unwrap(),
            converter: Converter::new(rig),
            gate: Gate::new(GateConfig::for_profile(
                PROFILE,
                SESSION,
                ACQUISITION,
                rig.axes.len(),
                std::array::from_fn(volts_max),
            )),
            law: Law::new(LawConfig::of_rig(rig)),
            machine: Interlock::new(Config::for_profile(
                PROFILE, SESSION, WATCHDOG, &rig.axes, false,
            )),
            player: Player::default(),
            program: Arc::new(Program::new(&protocol, rig).unwrap()),
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
            newest_sample: None,
            setpoint: None,
            sequences: [0; 3],
            cycles: Vec::new(),
        }
    }

    fn next(&mut self, topic: usize) -> u64 {
        self.sequences[topic] += 1;
        self.sequences[topic] - 1
    }

    fn simulator(&mut self, tick: u64, now: u64) {
        for (toggles, time_ns) in self.lines.drain(..) {
            self.card.enable_line(1, toggles, time_ns);
        }
        if let Some(volts) = self.output.take() {
            self.card.write(volts, 0, ACQUISITION);
        }
        let scan = self.card.clock(tick, now);
        self.scans.push(Scan::of_card(&scan, self.present));
    }

    fn acquisition(&mut self, now: u64) {
        for token in self.tokens.drain(..) {
            self.gate.observe_token(&token);
        }
        for command in self.commands.drain(..) {
            self.gate.observe_command(&command);
        }
        let output = self.gate.step(now);
        self.output = Some(output.volts);
        for scan in std::mem::take(&mut self.scans) {
            let sample = Sample {
                session: SESSION,
                incarnation: ACQUISITION,
                sequence: self.next(0),
                time_ns: now,
                output_v: output.volts,
                epoch: output.epoch,
                token_sequence: output.token_sequence,
                command_incarnation: output.command_incarnation,
                command_sequence: output.command_sequence,
                gate_state: output.state.code(),
                gate_cause: output.cause.code(),
                backend: ipc_types::CardKind::Simulated.code(),
                profile: PROFILE.code(),
                ..self.converter.convert(&scan)
            };
            self.watched_samples.push(sample);
            self.newest_sample = Some(sample);
        }
    }

    fn control(&mut self, now: u64) {
        let Some(sample) = self.newest_sample else { return };
        let token = self.newest_token;
        let powered = token.is_some_and(|token| {
            token.enabled == 1
                && token.control_incarnation == CONTROL
                && sample.epoch == token.epoch
                && sample.gate_state == GateState::Open.code()
        });
        let command = self.law.step(now, &sample, self.setpoint.as_ref(), powered);
        self.cycles.push(Cycle { sample, setpoint: self.setpoint, powered, command });
        let command = MotorCommand {
            session: SESSION,
            incarnation: CONTROL,
            sequence: self.next(1),
            time_ns: now,
            token_sequence: token.map_or(0, |token| token.sequence),
            epoch: token.map_or(0, |token| token.epoch),
            profile: PROFILE.code(),
            ..command
        };
        self.commands.push(command);
        self.watched_commands.push(command);
    }

    fn watchdog(&mut self, now: u64) {
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
        assert!(!tripped, "{:?}", self.machine.cause());
        if let Some(verb) = verb {
            let _refused = self.machine.command(verb, now);
        }
        let outputs = self.machine.step(now, Peers { launcher_alive: true, keeper_alive: true });
        // The machine counts its tokens itself, and the publisher stamps the same number.
        let token =
            EnableToken { session: SESSION, incarnation: WATCHDOG, time_ns: now, ..outputs.token };
        self.tokens.push(token);
        self.newest_token = Some(token);
        self.toggles += u64::from(outputs.toggle_line);
        self.lines.push((self.toggles, now));
    }

    fn experiment(&mut self, now: u64, begin: bool) {
        if begin {
            self.player.start(Arc::clone(&self.program), 1);
        }
        let measured = self.newest_sample.map_or([f64::NAN; AXES], |sample| {
            std::array::from_fn(|axis| match sample.master_present >> axis & 1 {
                1 => sample.master_position[axis],
                _ => f64::NAN,
            })
        });
        if let Some(setpoint) = self.player.step(now, &measured).setpoint {
            let sequence = self.next(2);
            self.setpoint = Some(Setpoint {
                session: SESSION,
                incarnation: EXPERIMENT,
                sequence,
                time_ns: now,
                ..setpoint
            });
        }
    }
}

/// Periods of the card that pass before control starts: the lock-step rig's control sees the third
/// scan first.
const BEFORE_CONTROL: u64 = 2;
/// The lock-step rig's card counts its first scan so.
const LOCK_STEP_FIRST_TICK: u64 = 2;

/// Runs the cores for that many periods of the card; returns the tick of the first scan and
/// control's cycles.
fn run_live(rig: &RigFile, protocol: &str, periods: u64) -> (u64, Vec<Cycle>) {
    let card = rig.rates.acquisition_period_ns();
    let ratio = rig.rates.control_period_ns() / card;
    // A clock that has been running for hours, and a card that comes up so that control's grid hits
    // its third scan.
    let first = (20_000_000 / 12) * 12 + 12 * ratio - BEFORE_CONTROL;
    let mut live = Rig::new(rig, protocol);
    let phases = rig.phases;
    let mut begun = false;
    for tick in first..first + periods {
        let start = tick * card;
        // All that happens within this period of the card, in the order of the phases; on a wrap,
        // in the next one.
        let mut due: Vec<(u64, u8)> = vec![(phases.simulator_ns, 0), (phases.acquisition_ns, 1)];
        for (period, phase, who) in [
            (rig.rates.control_period_ns(), phases.control_ns, 2),
            (rig.rates.watchdog_period_ns(), phases.watchdog_ns, 3),
            (rig.rates.experiment_period_ns(), phases.experiment_ns, 4),
        ] {
            let within = (start % period, start % period + card);
            if (within.0..within.1).contains(&(phase % period)) {
                due.push((phase - within.0, who));
            }
        }
        due.sort_unstable();
        for (after, who) in due {
            let now = start + after;
            match who {
                0 => live.simulator(tick, now),
                1 => live.acquisition(now),
                2 if tick >= first + BEFORE_CONTROL => live.control(now),
                2 => {}
                3 => live.watchdog(now),
                _ => {
                    // The protocol begins a while after power.
                    let begin = !begun && tick > first + 400;
                    begun |= begin;
                    live.experiment(now, begin);
                }
            }
        }
    }
    assert_eq!(live.machine.state(), WatchdogState::Enabled, "{:?}", live.machine.cause());
    assert_eq!(live.gate.state(), GateState::Open);
    (first, live.cycles)
}

/// What of a sample the machine decides, as bits.
fn machine_of(sample: &Sample) -> impl PartialEq + std::fmt::Debug + use<> {
    (
        sample.master_counts,
        sample.slave_counts,
        sample.analog_v.map(f64::to_bits),
        sample.motor_v.map(f64::to_bits),
        (sample.master_position, sample.slave_position, sample.slave_torque, sample.axes),
    )
}

/// What of a command the law decides, as bits.
fn law_of(command: &MotorCommand) -> impl PartialEq + std::fmt::Debug + use<> {
    (
        command.volts.map(f64::to_bits),
        command.feedforward_v.map(f64::to_bits),
        command.reference_position.map(f64::to_bits),
        command.reference_velocity.map(f64::to_bits),
        command.velocity.map(f64::to_bits),
        (command.mode, command.axes, command.limited, command.ramping, command.lapsed),
    )
}

fn assert_equal(rig: &RigFile, protocol: &str, periods: u64) {
    let (first, cycles) = run_live(rig, protocol, periods);
    let period = rig.rates.acquisition_period_ns();
    // From the rig's clock to the lock-step rig's (ns).
    let shift = |time_ns: u64| time_ns - (first - LOCK_STEP_FIRST_TICK) * period;
    let mut system = LockStepRig::new(rig, &[]).unwrap();
    let mut moved = [0.0_f64; AXES];
    for (at, cycle) in cycles.iter().enumerate() {
        assert_eq!(shift(cycle.sample.scan_time_ns), system.scan_ns(), "cycle {at}");
        let setpoint = cycle.setpoint.map(|setpoint| Setpoint {
            at_ns: shift(setpoint.at_ns),
            lease_until_ns: shift(setpoint.lease_until_ns),
            ..setpoint
        });
        let moment = system.cycle_with(setpoint.as_ref(), cycle.powered).unwrap();
        assert_eq!(machine_of(&moment.sample), machine_of(&cycle.sample), "cycle {at}");
        assert_eq!(law_of(&moment.command), law_of(&cycle.command), "cycle {at}");
        for (moved, position) in moved.iter_mut().zip(moment.sample.slave_position) {
            *moved = moved.max(position.abs());
        }
        assert!(!cycle.powered || moment.sample.motor_power == 1);
    }
    let powered = cycles.iter().filter(|cycle| cycle.powered).count();
    let led = cycles.iter().filter(|cycle| cycle.command.volts != [0.0; AXES]).count();
    let axes = rig.axes.len();
    println!(
        "{} at {} Hz: {} cycles equal, {powered} of them with power, {led} with volts; \
         handle up to {:.1?}°",
        rig.name,
        rig.rates.control_hz,
        cycles.len(),
        &moved.map(f64::to_degrees)[..axes]
    );
    assert!(powered > cycles.len() / 2 && led > cycles.len() / 3);
    assert!(moved[..axes].iter().all(|moved| moved.to_degrees() > 5.0), "{moved:?}");
}

const ONE_AXIS: &str = r#"[protocol]
name = "one"

[[segments]]
kind = "guided_sine"
amplitude_deg = 25.0
frequency_hz = 1.0
duration_s = 2.5
fade_in_s = 0.8

[[segments]]
kind = "steps"
positions_deg = [15.0, 0.0]
rise_s = 0.4
dwell_s = 0.3
"#;

const THREE_AXES: &str = r#"[protocol]
name = "three"

[[segments]]
kind = "guided_sine"
axes = [0, 1, 2]
phases_deg = [0.0, 120.0, 240.0]
amplitude_deg = 20.0
frequency_hz = 1.0
duration_s = 3.0
fade_in_s = 0.5
"#;

/// Also with control at the card's own rate, where every single scan is answered and compared.
#[test]
fn live_and_offline_agree_on_one_axis_at_every_rate() {
    for control_hz in [500, 1000, 2000] {
        let mut rig =
            RigFile::parse(include_str!("../../../launch/rigs/hydrostatic.toml"), "rig.toml")
                .unwrap();
        rig.rates.control_hz = control_hz;
        assert_equal(&rig, ONE_AXIS, 9000);
    }
}

#[test]
fn live_and_offline_agree_on_a_cable() {
    let rig = RigFile::parse(include_str!("../../../launch/rigs/cable.toml"), "rig.toml").unwrap();
    assert_equal(&rig, ONE_AXIS, 9000);
}

#[test]
fn live_and_offline_agree_on_three_axes() {
    let rig =
        RigFile::parse(include_str!("../../../launch/rigs/three-axis.toml"), "rig.toml").unwrap();
    assert_equal(&rig, THREE_AXES, 8000);
}

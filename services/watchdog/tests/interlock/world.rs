//! A simulated rig round the interlock: a card, a gate and a control process.

use std::sync::LazyLock;

use ipc_types::program_flow::{ACQUISITION_CYCLE, CONTROL_CYCLE, Checkpoint, signature};
use ipc_types::{
    CardKind, EnableToken, GateState, MotorCommand, Profile, Sample, Verb, WatchdogState,
};
use rig::RigFile;
use watchdog::interlock::{Config, Interlock, Outputs, Peers, Refusal, TorqueInput};

pub(crate) const MS: u64 = 1_000_000;
pub(crate) const SESSION: u64 = 11;
pub(crate) const COUNT: f64 = std::f64::consts::TAU / 4000.0;

/// The rig file that all configurations begin with; it is read once.
static RIG: LazyLock<RigFile> = LazyLock::new(|| rig::load_rig("hydrostatic".as_ref()).unwrap());

pub(crate) fn config(profile: Profile) -> Config {
    let mut rig = RIG.clone();
    let mut axis = rig.axes[0].clone();
    axis.limits = rig::Limits {
        position_min: -1.0,
        position_max: 1.0,
        speed_max: 20.0,
        volts_max: 5.0,
        torque_max: Some(10.0),
        encoder_jump_counts: 20,
    };
    axis.torque = None;
    axis.homing = Some(rig::Homing::Stops(rig::StopSearch {
        lower: -0.9,
        upper: 0.9,
        tolerance: 0.1,
        volts_max: 3.0,
        speed_max: 2.0,
        travel_max: 1.5,
        time_max_s: 0.5,
    }));
    axis.master.counts_per_unit = 1.0 / COUNT;
    axis.slave = Some(axis.master);
    axis.plausibility = rig::Plausibility {
        following_error_max: 0.2,
        following_error_time_s: 0.05,
        disagreement_max: 0.3,
        stuck_travel_max: 0.15,
        saturation_time_s: 0.1,
        thermal: Some(rig::ThermalRating { continuous_v: 3.0, time_constant_s: 0.2 }),
    };
    rig.axes = vec![axis];
    // One command for each step of the watchdog.
    rig.rates.control_hz = 1000;
    Config {
        // The torque itself comes as `Sample::slave_torque`.
        torque_inputs: [
            Some(TorqueInput { channel: 0, range_v: 10.0, stuck_ns: None }),
            None,
            None,
        ],
        ..Config::for_profile(profile, SESSION, 31, &rig)
    }
}

/// A healthy rig around the interlock: a card, a gate and a control process.
#[derive(Clone)]
pub(crate) struct World {
    pub(crate) interlock: Interlock,
    pub(crate) now: u64,
    pub(crate) peers: Peers,
    pub(crate) sample: Sample,
    pub(crate) command: MotorCommand,
    pub(crate) token: EnableToken,
    pub(crate) acquisition_runs: bool,
    pub(crate) control_runs: bool,
    pub(crate) gate_obeys: bool,
    /// Whether motor power follows the permission; else it stays as `sample` has it.
    pub(crate) relay_obeys: bool,
    /// Checkpoints of the cycles of acquisition and control.
    pub(crate) flows: [Vec<Checkpoint>; 2],
    /// How many tokens before the newest the one is that the flows of both answer.
    pub(crate) answers_behind: [u64; 2],
}

impl World {
    pub(crate) fn new(profile: Profile) -> Self {
        let sample = Sample {
            session: SESSION,
            incarnation: 21,
            axes: 1,
            master_present: 1,
            slave_present: 1,
            torque_present: 1,
            motor_present: 1,
            analog_present: 1,
            homed: 1,
            backend: CardKind::Simulated.code(),
            profile: profile.code(),
            ..Sample::default()
        };
        let command = MotorCommand {
            session: SESSION,
            incarnation: 41,
            profile: profile.code(),
            ..MotorCommand::default()
        };
        Self {
            interlock: Interlock::new(config(profile)),
            now: 1_000 * MS,
            peers: Peers::ALIVE,
            flows: [ACQUISITION_CYCLE.to_vec(), CONTROL_CYCLE.to_vec()],
            answers_behind: [0; 2],
            sample,
            command,
            token: EnableToken::default(),
            acquisition_runs: true,
            control_runs: true,
            gate_obeys: true,
            relay_obeys: true,
        }
    }

    /// Signature of the cycle of acquisition (0) or control (1).
    fn flow(&self, process: usize) -> u16 {
        let answered = self.token.sequence.saturating_sub(self.answers_behind[process]);
        signature(&self.flows[process], answered)
    }

    pub(crate) fn sample_now(&mut self) {
        self.sample.sequence += 1;
        self.sample.tick += 1;
        self.sample.time_ns = self.now;
        self.sample.scan_time_ns = self.now;
        self.sample.token_sequence = self.token.sequence;
        self.sample.flow = self.flow(0);
        if self.gate_obeys {
            self.sample.epoch = self.token.epoch;
            let state = if self.token.enabled == 1 { GateState::Open } else { GateState::Closed };
            self.sample.gate_state = state.code();
        }
        if self.relay_obeys {
            self.sample.motor_power = self.token.enabled;
        }
        self.interlock.observe_sample(&self.sample);
    }

    pub(crate) fn command_now(&mut self) {
        self.command.sequence += 1;
        self.command.time_ns = self.now;
        self.command.computed_ns = self.now;
        self.command.sample_time_ns = self.sample.scan_time_ns;
        self.command.sample_tick = self.sample.tick;
        self.command.token_sequence = self.token.sequence;
        self.command.flow = self.flow(1);
        self.interlock.observe_command(&self.command);
    }

    pub(crate) fn step(&mut self) -> Outputs {
        let output = self.interlock.step(self.now, self.peers);
        assert_eq!(output.token.enabled == 1, self.interlock.state() == WatchdogState::Enabled);
        assert!(
            !output.toggle_line || self.interlock.state() == WatchdogState::Enabled,
            "the line toggles without permission"
        );
        assert_eq!(output.token.state, self.interlock.state().code());
        self.token = output.token;
        output
    }

    /// One millisecond: two samples, a command, a step.
    pub(crate) fn cycle(&mut self) -> Outputs {
        for _ in 0..2 {
            self.now += MS / 2;
            if self.acquisition_runs {
                self.sample_now();
            }
        }
        if self.control_runs {
            self.command_now();
        }
        self.step()
    }

    pub(crate) fn cycles(&mut self, count: usize) {
        for _ in 0..count {
            self.cycle();
        }
    }

    pub(crate) fn verb(&mut self, verb: Verb) -> Result<WatchdogState, Refusal> {
        self.interlock.command(verb, self.now)
    }

    /// A world that was brought into `state` the lawful way.
    pub(crate) fn in_state(profile: Profile, state: WatchdogState) -> Self {
        let mut world = Self::new(profile);
        world.cycles(30);
        let verbs: &[Verb] = match state {
            WatchdogState::Faulted => &[],
            WatchdogState::Disarmed => &[Verb::Reset],
            WatchdogState::Armed => &[Verb::Reset, Verb::Arm],
            WatchdogState::Enabled => &[Verb::Reset, Verb::Arm, Verb::Enable],
            WatchdogState::Tripped => &[Verb::Estop],
        };
        for &verb in verbs {
            world.verb(verb).unwrap_or_else(|refusal| panic!("{verb:?}: {refusal}"));
        }
        world.cycles(30);
        assert_eq!(world.interlock.state(), state);
        world
    }
}

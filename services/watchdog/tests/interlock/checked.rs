//! A rig round the interlock, beside a judge that knows only what a person did.

use ipc_types::{GateState, Profile, TripCause, Verb, WatchdogState};
use rig::WithoutLogger;
use watchdog::interlock::Interlock;

use crate::world::{MS, World, config};

/// One thing that may happen.
#[derive(Clone, Debug)]
pub(crate) enum Act {
    Cycles(u8),
    Verb(Verb),
    Late(u64),
    Backwards(u64),
    Acquisition(bool),
    Control(bool),
    Launcher(bool),
    Keeper(bool),
    GateObeys(bool),
    Gate(u8),
    Position(f64),
    Counts(i64),
    Volts(f64),
    Torque(f64),
    Present(u8),
    AcquisitionRestarts,
    ControlRestarts,
    WatchdogRestarts,
    Session(u64),
    Sequence(u64),
    Backend(u8),
}

/// What a person did since the last fault, judged without looking into the interlock.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Steps {
    Nothing,
    Reset,
    Armed,
    Enabled,
}

/// Whether a fault trips nothing, as the safety case says and not as the interlock does: the
/// keeper's loss, and the logger's unless the rig file says that it trips.
const fn trips_nothing(cause: TripCause, without_logger: WithoutLogger) -> bool {
    match cause {
        TripCause::KeeperLost => true,
        TripCause::LoggerLost => !matches!(without_logger, WithoutLogger::Trip),
        _ => false,
    }
}

/// The rig and its judge.
#[derive(Clone)]
pub(crate) struct Checked {
    world: World,
    profile: Profile,
    without_logger: WithoutLogger,
    steps: Steps,
    last_epoch: u64,
}

impl Checked {
    /// A rig that has just come up.
    pub(crate) fn new(profile: Profile) -> Self {
        let mut world = World::new(profile);
        world.cycles(30);
        let without_logger = config(profile).without_logger;
        Self { world, profile, without_logger, steps: Steps::Nothing, last_epoch: 0 }
    }

    pub(crate) fn state(&self) -> WatchdogState {
        self.world.interlock.state()
    }

    /// Lets something happen; an error says what the interlock did and must not do: Enabled other
    /// than by reset, arm and enable after the last fault, a token enabled otherwise or with a
    /// fault, an epoch that does not rise.
    pub(crate) fn act(&mut self, act: &Act) -> Result<(), String> {
        let world = &mut self.world;
        match *act {
            Act::Verb(verb) => return self.verb(verb),
            Act::Cycles(count) => return (0..count).try_for_each(|_| self.cycle()),
            Act::Late(by) => world.now += by * MS,
            Act::Backwards(by) => world.now -= by * MS,
            Act::Acquisition(runs) => world.acquisition_runs = runs,
            Act::Control(runs) => world.control_runs = runs,
            Act::Launcher(alive) => world.peers.launcher_alive = alive,
            Act::Keeper(alive) => world.peers.keeper_alive = alive,
            Act::GateObeys(obeys) => world.gate_obeys = obeys,
            Act::Gate(state) => world.sample.gate_state = state,
            Act::Position(position) => world.sample.master_position[0] = position,
            Act::Counts(counts) => world.sample.master_counts[0] = counts,
            Act::Volts(volts) => world.command.volts[0] = volts,
            Act::Torque(torque) => world.sample.slave_torque[0] = torque,
            Act::Present(present) => world.sample.master_present = present,
            Act::AcquisitionRestarts => {
                world.sample.incarnation += 1;
                world.sample.sequence = 0;
                world.sample.gate_state = GateState::Closed.code();
                world.sample.epoch = 0;
            }
            Act::ControlRestarts => {
                world.command.incarnation += 1;
                world.command.sequence = 0;
            }
            Act::WatchdogRestarts => {
                world.interlock = Interlock::new(config(self.profile));
                self.steps = Steps::Nothing;
            }
            Act::Session(session) => world.sample.session = session,
            Act::Sequence(back) => {
                world.command.sequence = world.command.sequence.saturating_sub(back);
            }
            Act::Backend(backend) => world.sample.backend = backend,
        }
        Ok(())
    }

    fn verb(&mut self, verb: Verb) -> Result<(), String> {
        let answer = self.world.verb(verb);
        self.steps = match (verb, answer.is_ok(), self.steps) {
            (Verb::Estop, ..) => Steps::Nothing,
            (Verb::Disarm, _, steps) => steps.min(Steps::Reset),
            (Verb::Reset, true, Steps::Nothing | Steps::Reset) => Steps::Reset,
            (Verb::Arm | Verb::ArmUnchecked, true, Steps::Reset) => Steps::Armed,
            (Verb::Enable, true, Steps::Armed) => Steps::Enabled,
            (verb, true, steps) => return Err(format!("{verb:?} done after {steps:?}")),
            (_, false, steps) => steps,
        };
        if verb == Verb::Enable && answer.is_ok() {
            let token = self.world.step().token;
            if token.epoch <= self.last_epoch {
                return Err(format!("epoch {} after {}", token.epoch, self.last_epoch));
            }
            self.last_epoch = token.epoch;
        }
        Ok(())
    }

    fn cycle(&mut self) -> Result<(), String> {
        self.world.cycle();
        let token = self.world.token;
        let tripping = TripCause::ALL.iter().any(|&cause| {
            let active = token.faults & (1 << cause.code()) != 0;
            active && !trips_nothing(cause, self.without_logger)
        });
        if token.enabled == 1 && tripping {
            return Err(format!("enabled with the faults {:#b}", token.faults));
        }
        if token.enabled == 1 && token.epoch != self.last_epoch {
            return Err(format!("epoch {}, not {}", token.epoch, self.last_epoch));
        }
        let state = self.state();
        if matches!(state, WatchdogState::Faulted | WatchdogState::Tripped) {
            self.steps = Steps::Nothing;
        }
        if (state == WatchdogState::Enabled) != (self.steps == Steps::Enabled) {
            return Err(format!("{state} after {:?}", self.steps));
        }
        Ok(())
    }
}

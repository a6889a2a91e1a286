//! Properties of the interlock over arbitrary sequences of messages, verbs and steps.

use ipc_types::{
    GateState, Message, MotorCommand, Profile, Sample, TripCause, Verb, WatchdogState,
};
use proptest::prelude::*;
use watchdog::interlock::{FaultAction, Interlock, Peers, action_of};

use crate::world::{MS, SESSION, World, config};

#[derive(Clone, Debug)]
enum Act {
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

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![6 => Just(0.0), 2 => -2.0..2.0f64, 1 => any::<f64>(), 1 => Just(f64::NAN)]
}

fn act() -> impl Strategy<Value = Act> {
    let verb = prop_oneof![
        6 => Just(Verb::Reset),
        6 => Just(Verb::Arm),
        6 => Just(Verb::Enable),
        1 => Just(Verb::Disarm),
        1 => Just(Verb::Estop),
    ];
    prop_oneof![
        20 => (1u8..40).prop_map(Act::Cycles),
        40 => verb.prop_map(Act::Verb),
        1 => (0u64..80).prop_map(Act::Late),
        1 => (1u64..5).prop_map(Act::Backwards),
        4 => prop_oneof![3 => Just(true), 1 => Just(false)].prop_map(Act::Acquisition),
        4 => prop_oneof![3 => Just(true), 1 => Just(false)].prop_map(Act::Control),
        4 => prop_oneof![3 => Just(true), 1 => Just(false)].prop_map(Act::Launcher),
        4 => prop_oneof![3 => Just(true), 1 => Just(false)].prop_map(Act::Keeper),
        4 => prop_oneof![3 => Just(true), 1 => Just(false)].prop_map(Act::GateObeys),
        1 => any::<u8>().prop_map(Act::Gate),
        2 => number().prop_map(Act::Position),
        2 => prop_oneof![3 => Just(0i64), 1 => any::<i64>()].prop_map(Act::Counts),
        2 => number().prop_map(Act::Volts),
        2 => number().prop_map(Act::Torque),
        2 => prop_oneof![3 => Just(1u8), 1 => any::<u8>()].prop_map(Act::Present),
        1 => Just(Act::AcquisitionRestarts),
        1 => Just(Act::ControlRestarts),
        1 => Just(Act::WatchdogRestarts),
        2 => prop_oneof![3 => Just(SESSION), 1 => Just(12)].prop_map(Act::Session),
        1 => (0u64..5).prop_map(Act::Sequence),
        2 => prop_oneof![3 => Just(0u8), 1 => any::<u8>()].prop_map(Act::Backend),
    ]
}

/// What a person did since the last fault, judged without looking into the interlock.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Steps {
    Nothing,
    Reset,
    Armed,
    Enabled,
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1_000))]

    /// Whatever happens: Enabled is reached by reset, arm, enable in this order after the last
    /// fault and never otherwise; a token is enabled only in Enabled and only without a fault;
    /// epochs rise strictly with each enable.
    #[test]
    fn sr_20_only_reset_arm_enable_in_order_give_power(
        realtime in any::<bool>(),
        acts in prop::collection::vec(act(), 1..150),
    ) {
        let profile = if realtime { Profile::Realtime } else { Profile::BestEffort };
        let mut world = World::new(profile);
        world.cycles(30);
        let mut steps = Steps::Nothing;
        let mut last_epoch = 0;
        for act in acts {
            match act {
                Act::Verb(verb) => {
                    let answer = world.verb(verb);
                    steps = match (verb, answer.is_ok(), steps) {
                        (Verb::Estop, ..) => Steps::Nothing,
                        (Verb::Disarm, _, steps) => steps.min(Steps::Reset),
                        (Verb::Reset, true, Steps::Nothing | Steps::Reset) => Steps::Reset,
                        (Verb::Arm, true, Steps::Reset) => Steps::Armed,
                        (Verb::Enable, true, Steps::Armed) => Steps::Enabled,
                        (verb, true, steps) => {
                            let what = format!("{verb:?} done after {steps:?}");
                            return Err(TestCaseError::fail(what));
                        }
                        (_, false, steps) => steps,
                    };
                    if verb == Verb::Enable && answer.is_ok() {
                        let token = world.step().token;
                        prop_assert!(token.epoch > last_epoch, "{} <= {last_epoch}", token.epoch);
                        last_epoch = token.epoch;
                    }
                }
                Act::Cycles(count) => {
                    for _ in 0..count {
                        world.cycle();
                        let token = world.token;
                        let faults = token.faults;
                        let tripping = TripCause::ALL.iter().any(|&cause| {
                            let active = faults & (1 << cause.code()) != 0;
                            active && action_of(cause) != FaultAction::Blocks
                        });
                        prop_assert!(token.enabled == 0 || !tripping, "faults {faults:#b}");
                        prop_assert!(token.enabled == 0 || token.epoch == last_epoch);
                        let state = world.interlock.state();
                        if matches!(state, WatchdogState::Faulted | WatchdogState::Tripped) {
                            steps = Steps::Nothing;
                        }
                        let enabled = state == WatchdogState::Enabled;
                        prop_assert_eq!(enabled, steps == Steps::Enabled);
                    }
                }
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
                    world.interlock = Interlock::new(config(profile));
                    steps = Steps::Nothing;
                }
                Act::Session(session) => world.sample.session = session,
                Act::Sequence(back) => {
                    world.command.sequence = world.command.sequence.saturating_sub(back);
                }
                Act::Backend(backend) => world.sample.backend = backend,
            }
        }
    }

    /// What the messages hold is arbitrary bytes: nothing panics, and no permission is given.
    #[test]
    fn sr_20_arbitrary_bytes_are_harmless(
        bytes in prop::collection::vec(
            (
                prop::collection::vec(any::<u8>(), size_of::<Sample>()),
                any::<u64>(),
                any::<bool>(),
            ),
            1..60,
        ),
    ) {
        let mut interlock = Interlock::new(config(Profile::Realtime));
        for (bytes, now, ours) in bytes {
            let mut sample = Sample::from_bytes(&bytes).unwrap();
            let mut command =
                MotorCommand::from_bytes(&bytes[..size_of::<MotorCommand>()]).unwrap();
            if ours {
                (sample.session, command.session) = (SESSION, SESSION);
            }
            interlock.observe_sample(&sample);
            interlock.observe_command(&command);
            for verb in [Verb::Reset, Verb::Arm, Verb::Enable] {
                let _ = interlock.command(verb, now);
            }
            let peers = Peers::ALIVE;
            prop_assert_eq!(interlock.step(now, peers).token.enabled, 0);
        }
    }
}

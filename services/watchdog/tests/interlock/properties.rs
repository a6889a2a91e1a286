//! Properties of the interlock over arbitrary sequences of messages, verbs and steps.

use ipc_types::{Message, MotorCommand, Profile, Sample, Verb};
use proptest::prelude::*;
use watchdog::interlock::{Interlock, Peers};

use crate::checked::{Act, Checked};
use crate::walk::cases;
use crate::world::{SESSION, config};

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![6 => Just(0.0), 2 => -2.0..2.0f64, 1 => any::<f64>(), 1 => Just(f64::NAN)]
}

fn act() -> impl Strategy<Value = Act> {
    let verb = prop_oneof![
        6 => Just(Verb::Reset),
        5 => Just(Verb::Arm),
        1 => Just(Verb::ArmUnchecked),
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
        2 => prop_oneof![6 => Just(0u8), 1 => 0u8..5, 1 => any::<u8>()].prop_map(Act::Backend),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(cases(1_000)))]

    /// Whatever happens: Enabled is reached by reset, arm, enable in this order after the last
    /// fault and never otherwise; a token is enabled only in Enabled and only without a fault;
    /// epochs rise strictly with each enable.
    #[test]
    fn sr_20_only_reset_arm_enable_in_order_give_power(
        realtime in any::<bool>(),
        acts in prop::collection::vec(act(), 1..150),
    ) {
        let profile = if realtime { Profile::Realtime } else { Profile::BestEffort };
        let mut checked = Checked::new(profile);
        for act in acts {
            if let Err(what) = checked.act(&act) {
                return Err(TestCaseError::fail(what));
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
            for verb in [Verb::Reset, Verb::Arm, Verb::ArmUnchecked, Verb::Enable] {
                let _ = interlock.command(verb, now);
            }
            let peers = Peers::ALIVE;
            prop_assert_eq!(interlock.step(now, peers).token.enabled, 0);
        }
    }
}

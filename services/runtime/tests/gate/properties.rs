//! Properties of the gate over arbitrary streams of messages, held against a slow oracle.

use ipc_types::{EnableToken, GateState, MotorCommand};
use proptest::prelude::*;
use runtime::gate::Gate;

use crate::checked::{Act, Checked};
use crate::walk::cases;
use crate::{ACQUISITION, CONTROL, CYCLE, MS, Rig, SESSION, WATCHDOG, config};

/// How far a count goes on from message to message: mostly it rises; rarely it stays, or falls.
fn rise() -> impl Strategy<Value = u64> {
    prop_oneof![40 => 1u64..4, 1 => Just(0), 1 => Just(-1i64 as u64), 1 => Just(-2i64 as u64)]
}

fn tokens() -> impl Strategy<Value = EnableToken> {
    let time = -8_000_000i64..2_000_000;
    (
        (
            prop_oneof![19 => Just(SESSION), 1 => Just(12)],
            prop_oneof![19 => Just(WATCHDOG), 1 => Just(32)],
            rise(),
        ),
        (
            prop_oneof![19 => Just(ACQUISITION), 1 => Just(22)],
            prop_oneof![19 => Just(CONTROL), 1 => Just(42)],
        ),
        (prop_oneof![4 => Just(0i64), 1 => time], prop_oneof![9 => Just(5 * MS), 1 => 0..6 * MS]),
        (
            prop_oneof![1 => Just(1u64), 16 => Just(2), 1 => Just(3)],
            prop_oneof![19 => Just(1u8), 1 => any::<u8>()],
            prop_oneof![29 => Just(0u64), 1 => Just(7)],
        ),
    )
        .prop_map(
            |(
                (session, watchdog, sequence),
                (acquisition, control),
                (issued, life),
                (epoch, enabled, forged),
            )| {
                EnableToken {
                    session,
                    incarnation: watchdog + forged,
                    watchdog_incarnation: watchdog,
                    acquisition_incarnation: acquisition,
                    control_incarnation: control,
                    // Relative; made absolute when it is played.
                    sequence,
                    issued_ns: issued as u64,
                    valid_until_ns: life,
                    epoch,
                    enabled,
                    ..EnableToken::default()
                }
            },
        )
}

fn volts() -> impl Strategy<Value = f64> {
    prop_oneof![
        30 => -5.0..5.0f64,
        1 => any::<f64>(),
        1 => Just(f64::NAN),
        1 => Just(f64::INFINITY),
        1 => Just(5.0),
    ]
}

fn commands() -> impl Strategy<Value = MotorCommand> {
    (
        (
            prop_oneof![29 => Just(SESSION), 1 => Just(12)],
            prop_oneof![19 => Just(CONTROL), 1 => Just(42)],
            rise(),
            rise(),
        ),
        (
            prop_oneof![12 => Just(0i64), 1 => -8_000_000i64..2_000_000],
            prop_oneof![12 => Just(0i64), 1 => -200_000i64..12_000_000],
        ),
        (
            volts(),
            prop_oneof![9 => -3.0..3.0f64, 1 => volts()],
            prop_oneof![29 => Just(0.0), 1 => volts()],
        ),
    )
        .prop_map(
            |((session, incarnation, sequence, tick), (computed, sample_age), (a, b, c))| {
                MotorCommand {
                    session,
                    incarnation,
                    sequence,
                    sample_tick: tick,
                    computed_ns: computed as u64,
                    sample_time_ns: sample_age as u64,
                    volts: [a, b, c],
                    ..MotorCommand::default()
                }
            },
        )
}

fn acts() -> impl Strategy<Value = Vec<Act>> {
    let step_ns = prop_oneof![20 => 0i64..1_000_000, 1 => -1_000_000i64..20_000_000];
    let act = prop_oneof![
        8 => tokens().prop_map(Act::Token),
        8 => commands().prop_map(Act::Command),
        16 => step_ns.prop_map(Act::Step),
        1 => Just(Act::WriteFailed),
        2 => Just(Act::NextEpoch),
    ];
    prop::collection::vec(act, 1..200)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(cases(2_000)))]

    /// Whatever arrives, in whatever order: volts other than 0 only with the oracle's consent,
    /// never beyond the limits, and never again for an epoch that was ended.
    #[test]
    fn sr_10_no_stream_of_messages_gets_volts_past_the_gate_unlawfully(acts in acts()) {
        let mut checked = Checked::new();
        for act in acts {
            if let Err(what) = checked.act(&act) {
                return Err(TestCaseError::fail(what));
            }
        }
    }

    /// In good order, whatever the jitter below the lives, it opens at once and stays open.
    #[test]
    fn sr_10_good_order_is_never_latched(
        gaps in prop::collection::vec((1u64..4_000_000, 1u8..4), 1..200),
    ) {
        let mut rig = Rig::new();
        for (gap, renewals) in gaps {
            rig.now += gap;
            for _ in 0..renewals {
                rig.renew();
                rig.now -= CYCLE;
                (rig.token.time_ns, rig.token.issued_ns) = (rig.now, rig.now);
                rig.token.valid_until_ns = rig.now + 5 * MS;
                (rig.command.time_ns, rig.command.computed_ns) = (rig.now, rig.now);
                rig.command.sample_time_ns = rig.now - CYCLE;
                rig.gate.observe_token(&rig.token);
                rig.gate.observe_command(&rig.command);
            }
            rig.now += 1;
            let output = rig.step();
            prop_assert_eq!((output.state, output.volts), (GateState::Open, rig.command.volts));
        }
    }

    /// The messages as raw bytes: nothing panics, nothing leaves the limits.
    #[test]
    fn sr_10_arbitrary_bytes_are_harmless(
        bytes in prop::collection::vec(
            (
                any::<bool>(),
                prop::collection::vec(any::<u8>(), size_of::<MotorCommand>()),
                any::<u64>(),
            ),
            1..50,
        ),
    ) {
        use ipc_types::Message;
        let mut gate = Gate::new(config());
        for (forge, bytes, now) in bytes {
            let mut token = EnableToken::from_bytes(&bytes[..size_of::<EnableToken>()]).unwrap();
            let mut command = MotorCommand::from_bytes(&bytes).unwrap();
            if forge {
                (token.session, command.session) = (SESSION, SESSION);
                (token.incarnation, token.watchdog_incarnation) = (WATCHDOG, WATCHDOG);
                (token.acquisition_incarnation, token.enabled) = (ACQUISITION, 1);
                token.control_incarnation = command.incarnation;
            }
            gate.observe_token(&token);
            gate.observe_command(&command);
            let output = gate.step(now);
            for (volts, limit) in output.volts.iter().zip([5.0, 3.0, 0.0]) {
                prop_assert!(volts.is_finite() && volts.abs() <= limit);
            }
        }
    }
}

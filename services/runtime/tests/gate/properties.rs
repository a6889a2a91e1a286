//! Properties of the gate over arbitrary streams of messages, held against a slow oracle.

use ipc_types::{AXES, EnableToken, GateState, MotorCommand};
use proptest::prelude::*;
use runtime::gate::{Gate, GateConfig};

use crate::{ACQUISITION, CONTROL, CYCLE, MS, Rig, SESSION, START, WATCHDOG, config};

/// One thing that may happen in front of a gate.
#[derive(Clone, Debug)]
enum Act {
    Token(EnableToken),
    Command(MotorCommand),
    Step(i64),
    WriteFailed,
}

/// What the slow oracle keeps: everything that ever arrived, in order.
#[derive(Default)]
struct Oracle {
    tokens: Vec<EnableToken>,
    commands: Vec<MotorCommand>,
}

impl Oracle {
    /// Whether these volts may be written now, judged from the whole history.
    fn allows(
        &self,
        config: &GateConfig,
        now: u64,
        volts: [f64; AXES],
    ) -> Result<(), &'static str> {
        let ensure = |holds: bool, what: &'static str| if holds { Ok(()) } else { Err(what) };
        let token = self.tokens.last().ok_or("no token")?;
        let command = self.commands.last().ok_or("no command")?;
        ensure(command.volts == volts, "not the newest command's volts")?;
        ensure(token.session == config.session && command.session == config.session, "session")?;
        ensure(token.enabled == 1, "not enabled")?;
        ensure(token.incarnation == token.watchdog_incarnation, "token's sender")?;
        ensure(
            token.acquisition_incarnation == config.acquisition_incarnation,
            "token's receiver",
        )?;
        ensure(token.control_incarnation == command.incarnation, "command's sender")?;
        let age = |then: u64| i128::from(now) - i128::from(then);
        let future = -i128::from(config.future_ns);
        ensure(
            age(token.issued_ns) >= future && age(token.time_ns) >= future,
            "token from the future",
        )?;
        ensure(age(token.issued_ns) <= i128::from(config.token_life_ns), "token too old")?;
        ensure(age(token.valid_until_ns) <= 0, "token expired")?;
        let life = i128::from(token.valid_until_ns) - i128::from(token.issued_ns);
        ensure((0..=i128::from(config.token_life_ns)).contains(&life), "token's life")?;
        ensure(
            age(command.computed_ns) >= future && age(command.time_ns) >= future,
            "command from the future",
        )?;
        ensure(age(command.computed_ns) <= i128::from(config.command_life_ns), "command too old")?;
        let sample_age = age(command.sample_time_ns);
        ensure(
            sample_age >= future && sample_age <= i128::from(config.max_sample_age_ns),
            "sample's age",
        )?;
        let withdrawn = |earlier: &EnableToken| {
            earlier.enabled != 1
                && earlier.session == config.session
                && earlier.incarnation == earlier.watchdog_incarnation
                && earlier.epoch >= token.epoch
        };
        ensure(!self.tokens.iter().any(withdrawn), "withdrawn before")?;
        // In sequence: nothing of the same sender that came before has a higher or the same number
        // (but the same message again), within this session.
        let earlier = &self.tokens[..self.tokens.len() - 1];
        ensure(
            !earlier.iter().rev().take_while(|t| t.epoch == token.epoch && *t != token).any(|t| {
                t.session == token.session
                    && t.incarnation == token.incarnation
                    && t.sequence >= token.sequence
            }),
            "token out of sequence",
        )
    }
}

fn tokens() -> impl Strategy<Value = EnableToken> {
    let time = -8_000_000i64..2_000_000;
    (
        (
            prop_oneof![19 => Just(SESSION), 1 => Just(12)],
            prop_oneof![9 => Just(WATCHDOG), 1 => Just(32)],
            0u64..4,
        ),
        (
            prop_oneof![19 => Just(ACQUISITION), 1 => Just(22)],
            prop_oneof![19 => Just(CONTROL), 1 => Just(42)],
        ),
        (prop_oneof![4 => Just(0i64), 1 => time], prop_oneof![9 => Just(5 * MS), 1 => 0..6 * MS]),
        (
            1u64..4,
            prop_oneof![9 => Just(1u8), 1 => any::<u8>()],
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
            0u64..4,
        ),
        (
            prop_oneof![6 => Just(0i64), 1 => -8_000_000i64..2_000_000],
            prop_oneof![6 => 0i64..2_000_000, 1 => -200_000i64..12_000_000],
        ),
        (
            volts(),
            prop_oneof![9 => -3.0..3.0f64, 1 => volts()],
            prop_oneof![29 => Just(0.0), 1 => volts()],
        ),
    )
        .prop_map(|((session, incarnation, sequence), (computed, sample_age), (a, b, c))| {
            MotorCommand {
                session,
                incarnation,
                sequence,
                computed_ns: computed as u64,
                sample_time_ns: sample_age as u64,
                volts: [a, b, c],
                ..MotorCommand::default()
            }
        })
}

fn acts() -> impl Strategy<Value = Vec<Act>> {
    let step_ns = prop_oneof![20 => 0i64..1_000_000, 1 => -1_000_000i64..20_000_000];
    let act = prop_oneof![
        8 => tokens().prop_map(Act::Token),
        8 => commands().prop_map(Act::Command),
        16 => step_ns.prop_map(Act::Step),
        1 => Just(Act::WriteFailed),
    ];
    prop::collection::vec(act, 1..200)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2_000))]

    /// Whatever arrives, in whatever order: volts other than 0 only with the oracle's consent,
    /// never beyond the limits, and never again for an epoch that was ended.
    #[test]
    fn sr_10_no_stream_of_messages_gets_volts_past_the_gate_unlawfully(acts in acts()) {
        let config = config();
        let mut gate = Gate::new(config);
        let mut oracle = Oracle::default();
        let mut now = START;
        let mut sequences = [100u64, 100];
        let mut ended = 0u64;
        let mut last_state = GateState::Closed;
        let mut last_epoch = 0;
        let mut stepped = false;
        for act in acts {
            match act {
                Act::Token(mut token) => {
                    // The sequence mostly rises; 0 of the strategy repeats it.
                    sequences[0] += token.sequence;
                    token.sequence = sequences[0];
                    token.issued_ns = now.wrapping_add(token.issued_ns);
                    token.valid_until_ns = token.issued_ns.saturating_add(token.valid_until_ns);
                    token.time_ns = token.issued_ns;
                    oracle.tokens.push(token);
                    gate.observe_token(&token);
                }
                Act::Command(mut command) => {
                    sequences[1] += command.sequence;
                    command.sequence = sequences[1];
                    command.computed_ns = now.wrapping_add(command.computed_ns);
                    command.sample_time_ns = now.wrapping_sub(command.sample_time_ns);
                    command.time_ns = command.computed_ns;
                    oracle.commands.push(command);
                    gate.observe_command(&command);
                }
                Act::WriteFailed => {
                    gate.write_failed();
                    if last_state == GateState::Open {
                        ended = ended.max(last_epoch);
                    }
                }
                Act::Step(by) => {
                    let backwards = by < 0;
                    now = now.wrapping_add(by as u64);
                    let output = gate.step(now);
                    for (volts, limit) in output.volts.iter().zip([5.0, 3.0, 0.0]) {
                        let allowed = volts.is_finite() && volts.abs() <= limit;
                        prop_assert!(allowed, "{:?} V", output.volts);
                    }
                    if output.state == GateState::Open {
                        let epoch = oracle.tokens.last().unwrap().epoch;
                        // The first step knows of no time before it.
                        prop_assert!(!backwards || !stepped, "open although time went backwards");
                        prop_assert!(epoch > ended, "open for {epoch}, ended up to {ended}");
                        if let Err(what) = oracle.allows(&config, now, output.volts) {
                            return Err(TestCaseError::fail(what));
                        }
                        last_epoch = epoch;
                    } else {
                        prop_assert_eq!(output.volts, [0.0; AXES]);
                        if last_state == GateState::Open {
                            ended = ended.max(last_epoch);
                        }
                    }
                    last_state = output.state;
                    stepped = true;
                }
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

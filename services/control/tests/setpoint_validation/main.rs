//! Which setpoints control follows.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::collections::BTreeSet;

use control::setpoint_validation::{Notice, REPORT_INTERVAL_NS, Refusal, SetpointValidation};
use ipc_types::{AXES, EventKind, Message, Mode, Process, Sample, Setpoint};
use proptest::prelude::*;
use rig::Limits;

const SESSION: u64 = 7;
const MS: u64 = 1_000_000;

fn validation() -> SetpointValidation {
    let limits =
        Limits { position_min: -2.0, position_max: 1.5, speed_max: 10.0, ..Limits::default() };
    SetpointValidation::new(SESSION, [limits].into_iter())
}

fn setpoint(sequence: u64, now_ns: u64) -> Setpoint {
    Setpoint {
        session: SESSION,
        incarnation: 61,
        sequence,
        at_ns: now_ns,
        lease_until_ns: now_ns + 100 * MS,
        mode: Mode::Position.code(),
        owner: Process::Experiment.code(),
        axes: 1,
        ..Setpoint::default()
    }
}

fn with(change: impl FnOnce(&mut Setpoint)) -> Setpoint {
    let mut changed = setpoint(1, 10 * MS);
    change(&mut changed);
    changed
}

#[test]
fn sr_25_refuses_what_the_rig_cannot_do_and_says_why() {
    let cases: Vec<(Refusal, Setpoint)> = vec![
        (Refusal::Session, with(|s| s.session = 8)),
        (Refusal::Unknown, with(|s| s.mode = 99)),
        (Refusal::Unknown, with(|s| s.owner = Process::Logger.code())),
        (Refusal::Axes, with(|s| s.axes = 2)),
        (Refusal::NotFinite, with(|s| s.position[0] = f64::NAN)),
        (Refusal::NotFinite, with(|s| s.velocity[0] = f64::INFINITY)),
        (Refusal::NotFinite, with(|s| s.acceleration[0] = f64::NAN)),
        (Refusal::Position, with(|s| s.position[0] = 1.51)),
        (Refusal::Position, with(|s| s.position[0] = -2.01)),
        (Refusal::Speed, with(|s| s.velocity[0] = -10.01)),
    ];
    for (expected, bad) in cases {
        let mut validation = validation();
        assert_eq!(validation.validate(10 * MS, &setpoint(0, 9 * MS)), Ok(()));
        assert_eq!(validation.validate(10 * MS, &bad), Err(expected), "{bad:?}");
        assert_eq!((validation.refused(expected), validation.refused_in_all()), (1, 1));
        // Nothing was changed: the next good one is followed.
        assert_eq!(validation.validate(11 * MS, &setpoint(1, 11 * MS)), Ok(()));
    }
}

#[test]
fn a_limit_itself_is_within_and_axes_beyond_the_rig_mean_nothing() {
    let at = |position, velocity| {
        with(|s| {
            (s.position, s.velocity) = ([position, f64::NAN, 99.0], [velocity, f64::NAN, 99.0]);
        })
    };
    // One millionth of the larger limit is rounding.
    let (slack, fastest) = (1e-6 * 2.0, 10.0 * (1.0 + 1e-6));
    for (position, velocity) in
        [(1.5, 10.0), (-2.0, -10.0), (1.5 + slack, fastest), (-2.0 - slack, -fastest)]
    {
        assert_eq!(validation().validate(0, &at(position, velocity)), Ok(()));
    }
}

#[test]
fn sr_25_modes_ask_for_the_numbers_that_they_use() {
    let of = |mode: Mode, position| {
        with(|s| {
            s.mode = mode.code();
            (s.position[0], s.velocity[0]) = (position, f64::NAN);
        })
    };
    let verdict = |mode, position| validation().validate(0, &of(mode, position));
    for mode in Mode::ALL.iter().copied() {
        let expected = if mode.moves() { Err(Refusal::NotFinite) } else { Ok(()) };
        assert_eq!(verdict(mode, 0.0), expected, "{mode}");
    }
    assert_eq!(verdict(Mode::Passive, f64::NAN), Ok(()));
    assert_eq!(verdict(Mode::Hold, f64::NAN), Ok(()), "it holds where it is");
    assert_eq!(verdict(Mode::Hold, 9.0), Err(Refusal::Position));
    assert_eq!(verdict(Mode::Impedance, 9.0), Ok(()), "a field's centre may lie anywhere");
    assert_eq!(verdict(Mode::Centre, f64::NAN), Err(Refusal::NotFinite));
    assert_eq!(verdict(Mode::Rhythm, f64::NAN), Err(Refusal::NotFinite));
}

#[test]
fn sr_25_order_is_kept_within_a_sender_and_a_replaced_sender_stays_out() {
    let mut validation = validation();
    assert_eq!(validation.validate(20 * MS, &setpoint(5, 20 * MS)), Ok(()));
    assert_eq!(
        validation.validate(21 * MS, &setpoint(5, 21 * MS)),
        Err(Refusal::Sequence),
        "the same again"
    );
    assert_eq!(validation.validate(21 * MS, &setpoint(4, 21 * MS)), Err(Refusal::Sequence));
    assert_eq!(validation.validate(21 * MS, &setpoint(6, 19 * MS)), Err(Refusal::Backwards));
    assert_eq!(validation.validate(22 * MS, &setpoint(9, 22 * MS)), Ok(()), "gaps are no disorder");
    assert_eq!(validation.validate(22 * MS, &setpoint(10, 22 * MS)), Ok(()), "at the same time");
    // The experiment was restarted: it counts from 0.
    let fresh = Setpoint { incarnation: 62, ..setpoint(0, 30 * MS) };
    assert_eq!(validation.validate(30 * MS, &fresh), Ok(()));
    // The old one wakes up.
    assert_eq!(validation.validate(31 * MS, &setpoint(11, 31 * MS)), Err(Refusal::Sequence));
}

#[test]
fn sr_25_another_owner_waits_for_the_lease() {
    let other = |now: u64| Setpoint {
        incarnation: 90,
        owner: Process::Operator.code(),
        ..setpoint(0, now)
    };
    let mut busy = validation();
    assert_eq!(busy.validate(0, &setpoint(0, 0)), Ok(()));
    assert_eq!(busy.validate(100 * MS, &other(100 * MS)), Err(Refusal::Owner));
    assert_eq!(busy.validate(101 * MS, &other(101 * MS)), Ok(()), "the lease has lapsed");
    assert_eq!(busy.validate(102 * MS, &setpoint(1, 102 * MS)), Err(Refusal::Owner));
    assert_eq!(busy.validate(202 * MS, &setpoint(2, 202 * MS)), Ok(()), "and back");
    // Who asked for nothing was refused nothing.
    let nothing = Setpoint { mode: Mode::Passive.code(), ..other(203 * MS) };
    assert_eq!(busy.validate(203 * MS, &nothing), Err(Refusal::Owner));
    assert_eq!((busy.refused(Refusal::Owner), busy.refused_in_all()), (3, 2));
    assert_eq!(busy.notice(203 * MS, Refusal::Owner, &nothing), None, "nor is it told");
    assert!(busy.notice(203 * MS, Refusal::Owner, &other(203 * MS)).is_some());
    // One that has let go of the motor keeps nobody waiting.
    let mut idle = validation();
    assert_eq!(
        idle.validate(0, &Setpoint { mode: Mode::Passive.code(), ..setpoint(0, 0) }),
        Ok(())
    );
    assert_eq!(idle.validate(MS, &other(MS)), Ok(()));
}

#[test]
fn each_reason_is_told_once_a_second_with_its_count() {
    let mut validation = validation();
    let mut told = vec![];
    for cycle in 0..2_000u64 {
        let now = cycle * MS;
        let mut bad = setpoint(cycle, now);
        if cycle % 2 == 0 {
            bad.position[0] = 9.0
        } else {
            bad.velocity[0] = 99.0
        }
        let refusal = validation.validate(now, &bad).unwrap_err();
        told.extend(validation.notice(now, refusal, &bad));
    }
    assert_eq!(REPORT_INTERVAL_NS, 1_000 * MS);
    let told: Vec<_> =
        told.iter().map(|notice| (notice.refusal, notice.sequence, notice.count)).collect();
    let (position, speed) = (Refusal::Position, Refusal::Speed);
    assert_eq!(
        told,
        [(position, 0, 1), (speed, 1, 1), (position, 1_000, 501), (speed, 1_001, 501)]
    );
}

#[test]
fn every_reason_fits_into_an_event() {
    let mut validation = validation();
    let mut texts = BTreeSet::new();
    for refusal in Refusal::ALL {
        let notice = validation.notice(0, refusal, &setpoint(3, 0)).unwrap();
        let event = Notice { count: 5, ..notice }.event();
        assert_eq!(event.text(), refusal.text());
        assert_eq!(
            (event.kind, event.source),
            (EventKind::SetpointRefused.code(), Process::Control.code(),)
        );
        assert_eq!((event.a, event.b), (3.0, 5.0));
        assert!(event.text().len() > 20 && texts.insert(refusal.text()), "{refusal:?}");
    }
}

proptest! {
    /// Whatever comes: what is followed is within the limits and in order, and the counts add up.
    #[test]
    fn sr_25_what_is_followed_is_in_range_and_in_order(
        bytes in prop::collection::vec(
            (
                prop::collection::vec(any::<u8>(), size_of::<Setpoint>()),
                any::<u64>(),
                any::<bool>(),
                -3.0..3.0f64,
                -12.0..12.0f64,
            ),
            1..60,
        ),
    ) {
        let mut validation = validation();
        let (mut followed, mut refused) = (None::<Setpoint>, 0);
        for (bytes, now, ours, position, velocity) in bytes {
            let mut came = Setpoint::from_bytes(&bytes).unwrap();
            if ours {
                (came.session, came.axes, came.owner) = (SESSION, 1, Process::Experiment.code());
                came.mode %= Mode::ALL.len() as u8;
                came.incarnation %= 3;
                came.position[0] = position;
                came.velocity[0] = velocity;
                came.acceleration[0] = 0.0;
            }
            match validation.validate(now, &came) {
                Ok(()) => {
                    prop_assert!(ours, "arbitrary bytes have no session");
                    let mode = Mode::from_code(came.mode).unwrap();
                    if !mode.is_force_controlled() && mode != Mode::Passive {
                        prop_assert!((-2.0 - 1e-5..=1.5 + 1e-5).contains(&came.position[0]));
                        prop_assert!(!mode.moves() || came.velocity[0].abs() <= 10.0 + 1e-4);
                    }
                    if let Some(before) = followed.filter(|b| b.incarnation == came.incarnation) {
                        prop_assert!(came.sequence > before.sequence && came.at_ns >= before.at_ns);
                    }
                    followed = Some(came);
                }
                Err(_) => refused += 1,
            }
        }
        let counted: u64 = Refusal::ALL.iter().map(|refusal| validation.refused(*refusal)).sum();
        prop_assert_eq!(counted, refused);
    }
}

/// A sample with these homed axes and this homing sequence.
fn sample(homed: u8, homing_sequence: u64) -> Sample {
    Sample { homed, homing_sequence, ..Sample::default() }
}

#[test]
fn sr_29_on_an_unhomed_axis_nothing_moves_but_the_search_and_the_hand() {
    let of = |mode: Mode, change: fn(&mut Setpoint)| {
        let mut validation = validation();
        validation.see(&sample(0, 4));
        validation.validate(
            0,
            &with(|s| {
                (s.mode, s.homing_sequence) = (mode.code(), 4);
                change(s);
            }),
        )
    };
    for mode in Mode::ALL.iter().copied() {
        let allowed =
            mode == Mode::Passive || mode == Mode::Initialise || mode.is_force_controlled();
        let expected = if allowed { Ok(()) } else { Err(Refusal::Unhomed) };
        assert_eq!(of(mode, |_| ()), expected, "{mode}");
    }
    assert_eq!(of(Mode::Hold, |s| s.position[0] = f64::NAN), Ok(()), "it holds where it is");
    // Positions of the search count from power-up.
    assert_eq!(of(Mode::Initialise, |s| s.position[0] = 3.0), Ok(()));
    let fields: [fn(&mut Setpoint); 7] = [
        |s| s.stiffness[0] = 0.5,
        |s| s.stiffness[1] = 0.5,
        |s| s.damping[0] = -0.1,
        |s| s.inertia[0] = 0.01,
        |s| s.wall_stiffness[0] = 1.0,
        |s| s.table_position_max[0] = 1.0,
        |s| s.table_speed[0] = 1.0,
    ];
    for (number, field) in fields.into_iter().enumerate() {
        assert_eq!(of(Mode::Impedance, field), Err(Refusal::Unhomed), "field {number}");
    }
}

#[test]
fn sr_29_an_unhomed_axis_is_told_from_a_homed_one() {
    let limits =
        Limits { position_min: -2.0, position_max: 1.5, speed_max: 10.0, ..Limits::default() };
    for unhomed in 0..2 {
        let homed = 1 - unhomed;
        let verdict = |mode: Mode, change: &dyn Fn(&mut Setpoint)| {
            let mut validation = SetpointValidation::new(SESSION, [limits; 2].into_iter());
            validation.see(&sample(1 << homed, 0));
            let setpoint = with(|s| {
                (s.mode, s.axes) = (mode.code(), 2);
                change(s);
            });
            validation.validate(0, &setpoint)
        };
        assert_eq!(verdict(Mode::Position, &|_| ()), Err(Refusal::Unhomed));
        // The search may go anywhere on the one, and within the limits on the other.
        assert_eq!(verdict(Mode::Initialise, &|s| s.position[unhomed] = 3.0), Ok(()));
        let beyond = verdict(Mode::Initialise, &|s| s.position[homed] = 3.0);
        assert_eq!(beyond, Err(Refusal::Position));
        // Each row of a field's matrices is one axis's.
        for column in 0..AXES {
            let field =
                |axis: usize| move |s: &mut Setpoint| s.stiffness[axis * AXES + column] = 0.5;
            assert_eq!(verdict(Mode::Impedance, &field(homed)), Ok(()), "column {column}");
            let unlawful = verdict(Mode::Impedance, &field(unhomed));
            assert_eq!(unlawful, Err(Refusal::Unhomed), "column {column}");
        }
    }
}

#[test]
fn sr_29_a_setpoint_of_an_earlier_zero_is_refused() {
    let mut validation = validation();
    validation.see(&sample(1, 4));
    let of = |sequence, homing_sequence| {
        with(|s| (s.sequence, s.homing_sequence) = (sequence, homing_sequence))
    };
    assert_eq!(validation.validate(0, &of(1, 4)), Ok(()));
    validation.see(&sample(1, 5));
    assert_eq!(validation.validate(0, &of(2, 4)), Err(Refusal::Zero));
    assert_eq!(validation.validate(0, &of(3, 5)), Ok(()));
    let passive = with(|s| (s.sequence, s.mode) = (4, Mode::Passive.code()));
    assert_eq!(validation.validate(0, &passive), Ok(()), "0 V means the same in any positions");
}

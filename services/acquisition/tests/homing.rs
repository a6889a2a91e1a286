//! When positions are absolute, and from which zeros they count (SR-27).
#![allow(clippy::unwrap_used)]

use acquisition::Converter;
use acquisition::homing::{Changes, Homing, HomingState, Lost, OrderRefusal};
use ipc_types::HomeOrder;
use proptest::prelude::*;
use rig::RigFile;
use runtime::daq::{Present, Scan};

const SESSION: u64 = 3;
const POWER_UP: u64 = 17;

fn rig() -> RigFile {
    rig::load_rig("hydrostatic".as_ref()).unwrap()
}

fn scan(tick: u64, master: i64, slave: i64) -> Scan {
    Scan {
        tick,
        time_ns: 1_000_000 + tick * 500_000,
        master_counts: [master, 0, 0],
        slave_counts: [slave, 0, 0],
        present: Present { master: 1, slave: 1, motor: 1, analog: 0xff },
        power_up: POWER_UP,
        ..Scan::default()
    }
}

fn order(homing: &Homing, master: i64, slave: i64) -> HomeOrder {
    HomeOrder {
        homing_sequence: homing.zeros().sequence,
        master_zero: master,
        slave_zero: slave,
        ..HomeOrder::default()
    }
}

/// Powered up at these counts, and homed.
fn homed() -> Homing {
    let mut homing = Homing::new(&rig(), SESSION, None);
    homing.observe(&scan(1, 5000, -300));
    let changes = homing.order(&order(&homing, 4000, -1300)).unwrap();
    assert_eq!(changes, Changes { homed: 1, kept: true, ..Changes::default() });
    homing
}

#[test]
fn sr_27_positions_count_from_power_up_until_an_order_gives_the_zero() {
    let (rig, converter) = (rig(), Converter::new(&rig()));
    let mut homing = Homing::new(&rig, SESSION, None);
    assert_eq!(homing.order(&order(&homing, 0, 0)), Err(OrderRefusal::NoScan));
    let first = scan(1, 5000, -300);
    homing.observe(&first);
    let sample = converter.convert(&first, homing.zeros());
    assert_eq!((sample.homed, sample.master_counts[0], sample.slave_counts[0]), (0, 5000, -300));
    assert_eq!((sample.master_position[0], sample.slave_position[0]), (0.0, 0.0));
    let given = order(&homing, 4000, -1300);
    homing.order(&given).unwrap();
    let second = scan(2, 5000, -300);
    assert_eq!(homing.observe(&second), Changes::default());
    let after = converter.convert(&second, homing.zeros());
    let quarter = std::f64::consts::FRAC_PI_2;
    assert_eq!(after.homed, 1);
    assert!((after.master_position[0] - quarter).abs() < 1e-12);
    assert!((after.slave_position[0] - quarter).abs() < 1e-12);
    assert!(after.homing_sequence > sample.homing_sequence);
    // The same order again, as the experiment repeats it, changes nothing.
    assert_eq!(homing.order(&given), Err(OrderRefusal::Sequence));
    let other = HomeOrder { axis: 2, ..order(&homing, 1, 1) };
    assert_eq!(homing.order(&other), Err(OrderRefusal::Axis));
    assert_eq!(homing.zeros().master[0], 4000);
}

#[test]
fn sr_27_a_restart_of_acquisition_keeps_the_zeros_a_power_up_does_not() {
    let before = homed();
    let kept = before.state().unwrap();
    let mut after = Homing::new(&rig(), SESSION, Some(&kept));
    // The handle moved in between, as it may.
    assert_eq!(after.observe(&scan(9000, 5500, 0)), Changes::default());
    assert_eq!(after.zeros(), before.zeros());

    let mut powered = Homing::new(&rig(), SESSION, Some(&kept));
    let changes = powered.observe(&Scan { power_up: POWER_UP + 1, ..scan(9000, 12, 34) });
    assert_eq!(changes.lost[0], Some(Lost::PowerUp));
    assert_eq!((powered.zeros().homed, powered.zeros().master[0]), (0, 12));
    assert!(powered.zeros().sequence > kept.zeros.sequence);

    let other = HomingState { session: SESSION + 1, ..kept };
    let mut stranger = Homing::new(&rig(), SESSION, Some(&other));
    stranger.observe(&scan(9000, 5000, 0));
    assert_eq!(stranger.zeros().homed, 0, "the state of another session");
    // The card is powered up while acquisition runs.
    let mut running = homed();
    let changes = running.observe(&Scan { power_up: POWER_UP + 1, ..scan(2, 0, 0) });
    assert_eq!((changes.lost[0], running.zeros().homed), (Some(Lost::PowerUp), 0));
}

#[test]
fn sr_27_a_count_that_jumps_and_an_absent_encoder_unhome() {
    let jump = rig().axes[0].limits.encoder_jump_counts;
    for (next, lost) in [
        (scan(2, 5000 + jump, -300), None),
        (scan(2, 5000 + jump + 1, -300), Some(Lost::Jump)),
        (scan(2, 5000, -300 - jump - 1), Some(Lost::Jump)),
        (scan(4, 5000, -300 - 3 * jump), None),
        (scan(2, i64::MIN, -300), Some(Lost::Jump)),
        (
            Scan { present: Present { master: 1, ..Present::default() }, ..scan(2, 5000, -300) },
            Some(Lost::Absent),
        ),
        (
            Scan { present: Present { slave: 1, ..Present::default() }, ..scan(2, 5000, -300) },
            Some(Lost::Absent),
        ),
    ] {
        let mut homing = homed();
        let before = homing.zeros().sequence;
        let changes = homing.observe(&next);
        assert_eq!(changes.lost[0], lost, "{next:?}");
        assert_eq!(homing.zeros().homed, u8::from(lost.is_none()));
        assert_eq!(homing.zeros().sequence > before, lost.is_some());
    }
}

#[test]
fn absolute_encoders_need_no_order_and_take_none() {
    let text = include_str!("../../../launch/rigs/emps.toml");
    let emps = RigFile::parse(text, "emps.toml").unwrap();
    for mut homing in [Homing::absolute(&rig()), Homing::absolute(&emps)] {
        assert_eq!(homing.observe(&scan(1, 77, 0)), Changes::default());
        assert_eq!(
            (homing.zeros().homed, homing.zeros().sequence, homing.zeros().master[0]),
            (1, 0, 0)
        );
        assert_eq!(homing.order(&order(&homing, 5, 5)), Err(OrderRefusal::Axis));
    }
    assert!(emps.check_homing().is_err() && rig().check_homing().is_ok());
}

proptest! {
    /// Whatever scans and orders come: an axis is homed only by an order, every change of a zero
    /// raises the sequence, and a restart at any moment changes nothing.
    #[test]
    fn sr_27_only_an_order_homes(steps in prop::collection::vec((0..5u8, -200i64..200), 1..60)) {
        let rig = rig();
        let mut homing = Homing::new(&rig, SESSION, None);
        let (mut counts, mut power_up) = (0, POWER_UP);
        for (tick, (kind, value)) in (1u64..).zip(steps) {
            let before = *homing.zeros();
            let mut ordered = false;
            match kind {
                0 => ordered = homing.order(&order(&homing, value, value)).is_ok(),
                1 => power_up += 1,
                2 => if let Some(state) = homing.state() {
                    homing = Homing::new(&rig, SESSION, Some(&state));
                    prop_assert_eq!(homing.zeros(), &before);
                },
                _ => counts += value,
            }
            homing.observe(&Scan { power_up, ..scan(tick, counts, counts) });
            let after = homing.zeros();
            prop_assert!(before.homed == 1 || after.homed == 0 || ordered);
            prop_assert!(*after == before || after.sequence > before.sequence);
        }
    }
}

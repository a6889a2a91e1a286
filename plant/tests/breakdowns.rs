//! What breaks in a machine: it does what it says, its energy is accounted for, and once it is over
//! the machine goes on from where it is.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use plant::coupled_axes::{self, HandleCoupling};
use plant::effects::breakdowns::{self, LIST};
use plant::effects::{Effect, Entry, Site};
use plant::transmission::{Input, Motion, Transmission};
use plant::transmission_kinds::{Kind, Plant};

const DT_S: f64 = 0.5e-3;

fn entry(id: &str) -> &'static Entry {
    LIST.iter().find(|entry| entry.id == id).unwrap()
}

fn broken(id: &str, site: Site, size: f64) -> Box<dyn Effect> {
    breakdowns::make(entry(id), site, size, 7).unwrap()
}

fn plant(kind: Kind, effects: Vec<Box<dyn Effect>>) -> Plant {
    kind.calibrated().plant(effects).unwrap()
}

fn one_axis(kind: Kind, effects: Vec<Box<dyn Effect>>) -> coupled_axes::Plant {
    coupled_axes::Plant::new(vec![plant(kind, effects)], &HandleCoupling::default()).unwrap()
}

fn push(kind: Kind) -> f64 {
    match kind {
        Kind::Hydrostatic => 6.0,
        Kind::Cable => 5.0,
    }
}

/// A movement to and fro by motor and hand; the motion after each step.
fn moved(plant: &mut Plant, steps: i32) -> Vec<Motion> {
    let volts = push(match plant {
        Plant::Hydrostatic(_) => Kind::Hydrostatic,
        Plant::Cable(_) => Kind::Cable,
    });
    (0..steps)
        .map(|index| {
            let time = f64::from(index) * DT_S;
            let motor_v = volts * (9.0 * time).sin();
            plant.step(Input { motor_v, hand_torque_nm: 2.0 * (4.0 * time).cos() }, DT_S);
            plant.motion()
        })
        .collect()
}

/// Every breakdown that a transmission can have, at each of its sites.
fn every_one() -> impl Iterator<Item = (Kind, &'static Entry, Site)> {
    Kind::ALL.iter().flat_map(|&kind| {
        let has = move |entry: &&Entry| kind == Kind::Hydrostatic || entry.id != "hose_rupture";
        LIST.iter()
            .filter(has)
            .flat_map(move |entry| entry.sites.iter().map(move |place| (kind, entry, place.site)))
    })
}

#[test]
fn its_energy_is_accounted_for_and_it_changes_the_motion() {
    for (kind, entry, site) in every_one() {
        let what = format!("{}@{site} in a {} transmission", entry.id, kind.name());
        let size = entry.parameters[0].printed;
        let mut with = plant(kind, vec![broken(entry.id, site, size)]);
        let (broken, whole) = (moved(&mut with, 4000), moved(&mut plant(kind, Vec::new()), 4000));
        let change = broken.iter().zip(&whole).map(|(a, b)| {
            (a.master_position_rad - b.master_position_rad).abs()
                + (a.slave_position_rad - b.slave_position_rad).abs()
        });
        let change = change.sum::<f64>() / whole.len() as f64;
        assert!(change.is_finite() && change > 1e-3, "{what}: {change}");
        let energy = with.energy();
        assert!(energy.defect_j().abs() <= 5e-3 * energy.throughput_j, "{what}: {energy:?}");
    }
}

#[test]
fn a_ruptured_hose_transmits_nothing_after_a_few_time_constants() {
    let size = 0.013;
    let mut plant = plant(Kind::Hydrostatic, vec![broken("hose_rupture", Site::Line, size)]);
    let push = Input { motor_v: 6.0, hand_torque_nm: 0.0 };
    for step in 0..400 {
        plant.step(push, DT_S);
        let torque = plant.motion().transmitted_torque_nm;
        if f64::from(step) * DT_S > 12.0 * size {
            assert!(torque.abs() < 1e-2, "step {step}: {torque} N·m");
        }
    }
    let motion = plant.motion();
    assert!(motion.master_position_rad > 1.0, "the master runs free: {motion:?}");
    assert!(motion.slave_position_rad.abs() < 0.05, "the slave is left: {motion:?}");
}

#[test]
fn a_slipping_pulley_transmits_no_more_than_it_says() {
    for (kind, site, torque) in [
        (Kind::Hydrostatic, Site::Master, 0.5),
        (Kind::Hydrostatic, Site::Slave, 0.0),
        (Kind::Cable, Site::Master, 0.05),
    ] {
        let mut plant = plant(kind, vec![broken("slip", site, torque)]);
        let mut most = 0.0_f64;
        for _ in 0..600 {
            plant.step(Input { motor_v: push(kind), hand_torque_nm: 0.0 }, DT_S);
            most = most.max(plant.motion().transmitted_torque_nm.abs());
        }
        let motion = plant.motion();
        if site == Site::Slave {
            assert!(most <= torque + 1e-9, "{most} N·m of {torque}");
            assert_eq!(motion.slave_position_rad, 0.0);
        }
        let along = motion.master_position_rad * ratio(kind) - motion.slave_position_rad;
        assert!(along > 0.5, "{}: it slips: {motion:?}", kind.name());
    }
}

/// Slave angle per master angle.
fn ratio(kind: Kind) -> f64 {
    kind.calibrated().transmission_ratio()
}

#[test]
fn a_seized_side_stands_from_the_first_step_on() {
    for &kind in Kind::ALL {
        let mut plant = plant(kind, vec![broken("seizure", Site::Slave, 1e3)]);
        let first = moved(&mut plant, 4000).iter().all(|motion| motion.slave_position_rad == 0.0);
        assert!(first, "{}: {:?}", kind.name(), plant.motion());
        assert!(plant.motion().master_position_rad.is_finite());
    }
}

/// A machine that breaks while it moves and is whole again: no position jumps, the torque of the
/// line stays within what an intact machine has, and at last slave follows master again.
#[test]
fn what_is_over_goes_on_from_where_it_is() {
    for (kind, entry, site) in every_one() {
        let what = format!("{}@{site} in a {} transmission", entry.id, kind.name());
        let mut machine = one_axis(kind, Vec::new());
        let mut step = 0;
        let mut run = |machine: &mut coupled_axes::Plant, steps: i32, share: f64| {
            let (mut torque, mut jump, mut travel) = (0.0_f64, 0.0_f64, [0.0_f64; 2]);
            let begun = machine.motion(0);
            for _ in 0..steps {
                let before = machine.motion(0);
                let motor_v = share * push(kind) * (9.0 * f64::from(step) * DT_S).sin();
                machine.step(&[Input { motor_v, hand_torque_nm: 0.0 }], DT_S);
                let motion = machine.motion(0);
                jump = jump
                    .max((motion.master_position_rad - before.master_position_rad).abs())
                    .max((motion.slave_position_rad - before.slave_position_rad).abs());
                torque = torque.max(motion.transmitted_torque_nm.abs());
                travel[0] = travel[0].max(motion.master_position_rad - begun.master_position_rad);
                travel[1] = travel[1].max(motion.slave_position_rad - begun.slave_position_rad);
                step += 1;
            }
            (torque, jump, travel)
        };
        let whole = run(&mut machine, 4000, 1.0);
        let size = entry.sites.iter().find(|place| place.site == site).unwrap().size;
        let mut next = one_axis(kind, vec![broken(entry.id, site, size)]);
        next.go_on_from(&machine);
        machine = next;
        // Gently: a master without its load is fast.
        let during = run(&mut machine, 200, 0.2);
        machine.end_breakdown(7);
        // Another change of the machine keeps what was left behind.
        let mut next = one_axis(kind, vec![broken(entry.id, site, size)]);
        next.go_on_from(&machine);
        machine = next;
        let _settling = run(&mut machine, 2000, 1.0);
        let after = run(&mut machine, 4000, 1.0);
        let most = 1.5 * whole.1 + 0.02;
        assert!(during.1 < most && after.1 < most, "{what}: {during:?} {after:?}, whole {whole:?}");
        assert!(after.0 < 1.2 * whole.0, "{what}: {after:?}, whole {whole:?}");
        let share = (after.2[1] / after.2[0]) / (whole.2[1] / whole.2[0]);
        assert!((0.5..2.0).contains(&share), "{what}: {after:?}, whole {whole:?}");
    }
}

//! A step allocates nothing, whatever effects there are: the plant runs inside real-time loops.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use plant::cable;
use plant::hydrostatic::{Input, Parameters, Plant, Transmission};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    static COUNT: Cell<usize> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: hands everything to the system's allocator and only counts besides.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.with(|count| count.set(count.get() + 1));
        // SAFETY: the caller keeps the contract of `GlobalAlloc::alloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the pointer came from `System` through `alloc`.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn a_step_allocates_nothing() {
    let mut all = Vec::new();
    for entry in plant::effects::LIST {
        for place in entry.sites {
            all.push(plant::effects::parse(&format!("{}@{}", entry.id, place.site)).unwrap());
        }
    }
    let mut plant = Plant::new(Parameters::calibrated(), all).unwrap();
    let before = COUNT.with(Cell::get);
    assert!(before > 0, "the counter counts");
    for index in 0..2000 {
        plant.step(
            Input { motor_v: 12.0 * (f64::from(index) * 0.01).sin(), hand_torque_nm: 0.5 },
            0.5e-3,
        );
    }
    assert_eq!(COUNT.with(Cell::get), before);
    assert!(plant.state().slave_position_rad.is_finite());
}

#[test]
fn friction_laws_and_sensors_allocate_nothing() {
    use common::laws::{LAWS, resistance};
    use plant::friction::OperatingPoint;
    use plant::sensors::{Drift, Emg, EmgParameters, TorqueCell, TorqueCellParameters};
    let mut laws: Vec<_> = LAWS.iter().map(|entry| (entry.build)()).collect();
    let cell = TorqueCellParameters {
        volts_per_nm: 1.0,
        offset_v: 0.0,
        noise_v: 0.1,
        bandwidth_hz: 100.0,
        limit_v: 10.0,
    };
    let mut cell =
        TorqueCell::new(cell, 1).with_drift(Drift { ramp_v_per_s: 0.1, walk_v_per_sqrt_s: 0.1 });
    let mut emg = Emg::new(EmgParameters::default(), 0.5e-3, 1).unwrap();
    let before = COUNT.with(Cell::get);
    let mut sum = 0.0;
    for index in 0..2000 {
        let position = (f64::from(index) * 0.01).sin();
        for law in &mut laws {
            let at =
                OperatingPoint { position, velocity: position, transmitted: 1.0, step: 0.5e-3 };
            sum += resistance(law.as_mut(), &at);
        }
        sum += cell.read(position, 0.5e-3) + emg.read(position)[0];
    }
    assert_eq!(COUNT.with(Cell::get), before);
    assert!(sum.is_finite());
}

#[test]
fn a_step_of_the_cable_transmission_allocates_nothing() {
    let mut all = Vec::new();
    for entry in plant::effects::LIST.iter().filter(|entry| entry.id != "leakage") {
        for place in entry.sites {
            all.push(plant::effects::parse(&format!("{}@{}", entry.id, place.site)).unwrap());
        }
    }
    let mut plant = cable::Plant::new(cable::Parameters::calibrated(), all).unwrap();
    let before = COUNT.with(Cell::get);
    for index in 0..2000 {
        plant.step(
            Input { motor_v: 12.0 * (f64::from(index) * 0.01).sin(), hand_torque_nm: 0.5 },
            0.5e-3,
        );
    }
    assert_eq!(COUNT.with(Cell::get), before);
    assert!(plant.state().slave_position_rad.is_finite());
}

#[test]
fn a_step_of_three_coupled_axes_allocates_nothing() {
    use plant::{coupled_axes, transmission_kinds};
    let handle = Parameters::calibrated().slave_inertia_kg_m2();
    let axis = || {
        transmission_kinds::Parameters::from(Parameters::calibrated()).plant(Vec::new()).unwrap()
    };
    let coupling =
        coupled_axes::HandleCoupling::of_pairs(3, &[0.3 * handle, -0.2 * handle, 0.2 * handle])
            .unwrap();
    let mut plant = coupled_axes::Plant::new(vec![axis(), axis(), axis()], &coupling).unwrap();
    let before = COUNT.with(Cell::get);
    for index in 0..2000 {
        let input = Input { motor_v: 8.0 * (f64::from(index) * 0.01).sin(), hand_torque_nm: 0.5 };
        plant.step(&[input; 3], 0.5e-3);
    }
    assert_eq!(COUNT.with(Cell::get), before);
    assert!(plant.motion(2).slave_position_rad.is_finite());
}

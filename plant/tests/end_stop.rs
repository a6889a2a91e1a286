//! Hard stops at the handle: they hold, they give no energy, and the torque cell does not see them.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use plant::effects::Effect;
use plant::effects::end_stop::EndStop;
use plant::transmission::{Input, Transmission};
use plant::transmission_kinds::{Parameters, Plant};
use plant::{cable, hydrostatic};
use proptest::prelude::*;

const STEP_S: f64 = 5e-4;

fn kinds() -> [Parameters; 2] {
    [hydrostatic::Parameters::calibrated().into(), cable::Parameters::calibrated().into()]
}

fn stopped(parameters: Parameters, lower: f64, upper: f64) -> Plant {
    let stop: Box<dyn Effect> = Box::new(EndStop::between(lower, upper));
    parameters.plant(vec![stop]).unwrap()
}

#[test]
fn a_pushing_hand_is_stopped_at_the_end_stop() {
    for parameters in kinds() {
        for side in [1.0, -1.0] {
            let mut plant = stopped(parameters.clone(), -0.3, 0.4);
            let input = Input { motor_v: 3.0 * side, hand_torque_nm: 4.0 * side };
            let end = if side > 0.0 { 0.4 } else { -0.3 };
            let mut farthest = 0.0f64;
            for _ in 0..8000 {
                plant.step(input, STEP_S);
                farthest = farthest.max((plant.motion().slave_position_rad - end) * side);
                assert_eq!(
                    plant.reading().slave_torque_nm,
                    4.0 * side,
                    "the torque cell measures the hand alone"
                );
            }
            let beyond = (plant.motion().slave_position_rad - end) * side;
            assert!(beyond > 0.0 && beyond < 0.06, "{beyond} rad beyond the stop");
            assert!(farthest < 0.12, "{farthest} rad");
        }
    }
}

#[test]
fn away_from_the_stops_nothing_changes() {
    for parameters in kinds() {
        let mut free = parameters.clone().plant(Vec::new()).unwrap();
        let mut stopped = stopped(parameters, -30.0, 30.0);
        for step in 0..4000 {
            let t = f64::from(step) * STEP_S;
            let input = Input { motor_v: 4.0 * (6.0 * t).sin(), hand_torque_nm: (11.0 * t).cos() };
            free.step(input, STEP_S);
            stopped.step(input, STEP_S);
            assert_eq!(free.motion(), stopped.motion(), "after {t} s");
        }
        let place = free.motion().slave_position_rad.abs();
        assert!(place > 1e-3 && place < 30.0, "{place} rad");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]

    /// Thrown against the stops by any input: the balance closes, and once nobody drives, what is
    /// stored in machine and stop only falls.
    #[test]
    fn an_end_stop_creates_no_energy(
        levels in prop::collection::vec((-6.0_f64..6.0, -4.0_f64..4.0), 5..20),
        lower in -0.4_f64..-0.05,
        upper in 0.05_f64..0.4,
        which in 0usize..2,
    ) {
        let mut plant = stopped(kinds()[which].clone(), lower, upper);
        for (motor_v, hand_torque_nm) in levels {
            for _ in 0..200 {
                plant.step(Input { motor_v, hand_torque_nm }, STEP_S);
            }
        }
        let energy = plant.energy();
        prop_assert!(energy.defect_j().abs() <= 2e-3 * energy.throughput_j, "{energy:?}");
        let stiffness = EndStop::between(lower, upper).stiffness;
        let total = |plant: &Plant| {
            let q = plant.motion().slave_position_rad;
            let beyond = q - q.max(lower).min(upper);
            plant.energy().stored_j + 0.5 * stiffness * beyond * beyond
        };
        let scale = energy.throughput_j.max(0.1);
        let mut last = total(&plant);
        for _ in 0..2000 {
            plant.step(Input::default(), STEP_S);
            let now = total(&plant);
            prop_assert!(now <= last + 1e-4 * scale, "{now} J after {last} J");
            last = now;
        }
    }
}

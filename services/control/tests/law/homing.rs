//! The law and the zeros that positions count from (SR-29).

use ipc_types::{AXES, Mode, Sample, Setpoint};
use rig::StopSearch;

use super::{SECOND, axis_law, config, sample, setpoint};
use control::law::{AxisLaw, Law};

const RATE: u64 = 500;
const STEP: u64 = SECOND / RATE;

fn search() -> StopSearch {
    StopSearch {
        lower: -1.0,
        upper: 1.0,
        tolerance: 0.1,
        volts_max: 2.0,
        speed_max: 3.0,
        travel_max: 6.0,
        time_max_s: 60.0,
    }
}

fn with_zero(sample: Sample, homed: u8, homing_sequence: u64) -> Sample {
    Sample { homed, homing_sequence, ..sample }
}

#[test]
fn sr_29_the_output_of_an_unhomed_axis_stays_within_that_of_the_search() {
    let law = AxisLaw { search: Some(search()), ..axis_law() };
    let volts_at_the_end = |homed: u8| {
        let mut law = Law::new(config(law, RATE));
        let mut largest = 0.0_f64;
        for step in 1..2 * RATE {
            let now = step * STEP;
            // A handle that is held, beyond the position limits of the homed axis.
            let seen = with_zero(sample(now, 3.0), homed, 4);
            let asked = Setpoint {
                homing_sequence: 4,
                ..setpoint(now, Mode::Position, [1.0, 0.0, 0.0, 0.0])
            };
            let command = law.step(now, &seen, Some(&asked), true);
            largest = largest.max(command.volts[0].abs());
        }
        largest
    };
    let (unhomed, homed) = (volts_at_the_end(0), volts_at_the_end(1));
    assert!((unhomed - 2.0).abs() < 1e-9, "{unhomed} V");
    assert!((homed - 5.0).abs() < 1e-9, "{homed} V");
}

#[test]
fn sr_29_a_setpoint_of_another_zero_moves_nothing() {
    let mut law = Law::new(config(axis_law(), RATE));
    let mut follow = |from: u64, homing_sequence: u64, position: f64, expected: bool| {
        for step in from..from + RATE {
            let now = step * STEP;
            let seen = with_zero(sample(now, position), 1, homing_sequence);
            let asked = Setpoint {
                homing_sequence: 4,
                ..setpoint(now, Mode::Position, [0.5, 0.0, 0.0, 0.0])
            };
            let command = law.step(now, &seen, Some(&asked), true);
            assert_eq!(command.lapsed == 0, expected, "step {step}");
            if !expected {
                // It holds where it is: the handle moved with its zero, not against it.
                assert_eq!(command.volts, [0.0; AXES], "step {step}");
                assert_eq!(command.reference_position[0], position);
            }
        }
    };
    follow(1, 4, 0.5, true);
    // From here the same handle is at -1.2: no setpoint of the old positions is followed.
    follow(1 + RATE, 5, -1.2, false);
}

//! The energy balance closes for any machine and any input.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use plant::hydrostatic::{Input, Parameters, Plant, Transmission};
use proptest::prelude::*;

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, ..ProptestConfig::default() })]

    #[test]
    fn balance_closes(
        length in 0.5_f64..20.0,
        diameter in 0.003_f64..0.020,
        softness in 0.0_f64..3.0,
        damping in 0.0_f64..100.0,
        slave_friction in 0.0_f64..3.0,
        motor_friction in 0.0_f64..1.5,
        levels in prop::collection::vec((-5.0_f64..5.0, -3.0_f64..3.0), 10..40),
    ) {
        let parameters = Parameters {
            line_stiffness_factor: (-softness).exp(),
            port_damping_n_s_per_m: damping,
            slave_static_friction_nm: slave_friction,
            slave_kinetic_friction_nm: (slave_friction - 1.2).max(0.0),
            motor_coulomb_nm: motor_friction,
            ..Parameters::printed()
        }
        .with_hose_length(length)
        .with_hose_diameter(diameter);
        let mut plant = Plant::new(parameters, Vec::new()).unwrap();
        let mut last_dissipated = 0.0;
        for (motor_v, hand_torque_nm) in levels {
            for _ in 0..60 {
                plant.step(Input { motor_v, hand_torque_nm }, 0.5e-3);
                let energy = plant.energy();
                let least = last_dissipated - 1e-9 * energy.throughput_j;
                prop_assert!(energy.dissipated_j >= least, "friction gives energy");
                last_dissipated = energy.dissipated_j;
            }
        }
        let energy = plant.energy();
        prop_assert!(energy.effects_j.abs() < 1e-9 * energy.throughput_j.max(1e-6));
        prop_assert!(
            energy.defect_j().abs() <= 1e-3 * energy.throughput_j,
            "open {} J of {:?}", energy.defect_j(), energy
        );
    }

    /// Once the power is off nothing moves for ever and nothing grows.
    #[test]
    fn stored_energy_only_falls_without_input(motor_v in -5.0_f64..5.0, softness in 0.0_f64..3.0) {
        let line_stiffness_factor = (-softness).exp();
        let parameters = Parameters { line_stiffness_factor, ..Parameters::printed() };
        let mut plant = Plant::new(parameters, Vec::new()).unwrap();
        for _ in 0..600 {
            plant.step(Input { motor_v, hand_torque_nm: 0.0 }, 0.5e-3);
        }
        let start = plant.energy().stored_j;
        let mut last = start;
        for _ in 0..2000 {
            plant.step(Input::default(), 0.5e-3);
            let stored = plant.energy().stored_j;
            prop_assert!(stored <= last + 2e-3 * start.max(1e-6), "{last} {stored} of {start}");
            last = stored;
        }
        prop_assert!(last <= start);
    }
}

//! The effective size of an effect.
//!
//! Some effects add to a declared constant; records reveal only the sum. Their effective value is
//! that sum: stiffness of the line, damping of a port, inertia or friction of a side, scale of the
//! torque cell. For a nonlinear spring it is the cubic coefficient in N/m³, for bristles their
//! stiffness. For all others it is the first parameter.

use crate::machine_parameters::MachineParameters;

/// The effective value of an effect `id` at `site` with its parameters, in a machine with these
/// constants. `None` if a parameter is missing.
pub fn value(
    id: &str,
    site: &str,
    machine: &MachineParameters,
    parameter: &dyn Fn(&str) -> Option<f64>,
    first: f64,
) -> Option<f64> {
    let side = usize::from(site == "slave");
    let half_line = 2.0 * machine.line_stiffness_n_per_m();
    let friction = |speed: f64| {
        if side == 0 { machine.master_friction_nm(speed) } else { machine.slave_friction_nm(speed) }
    };
    let found = match id {
        "line_compliance" => {
            machine.line_stiffness_n_per_m()
                / (1.0 + parameter("compliance_ratio").unwrap_or(first))
        }
        "line_damping" => machine.port_damping_n_s_per_m + first,
        "extra_inertia" => machine.inertia_kg_m2()[side] + first,
        // The kinetic value: the one at the corner speed.
        "coulomb_friction" => friction(6.0) + first,
        // Slope of the friction up to the corner.
        "viscous_friction" if side == 0 => machine.motor_viscous_nm_s + first,
        "viscous_friction" => first - machine.slave_falling_slope_nm_s,
        "sensor_gain" => 1.0 + first,
        "nonlinear_stiffness" => parameter("cubic")? * half_line.powi(3) / 400.0,
        "presliding_hysteresis" => parameter("part")? * friction(0.0) / parameter("travel")?,
        _ => first,
    };
    found.is_finite().then_some(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_effective_size_depends_on_the_total_only() {
        let mut soft = MachineParameters::declared();
        soft.line_stiffness_factor *= 0.8;
        let none = |_: &str| None;
        let one =
            value("line_compliance", "line", &MachineParameters::declared(), &none, 1.5).unwrap();
        let other = value("line_compliance", "line", &soft, &none, 1.0).unwrap();
        assert!((one / other - 1.0).abs() < 1e-12);
        assert_eq!(value("backlash", "slave", &soft, &none, 0.03), Some(0.03));
        assert_eq!(value("presliding_hysteresis", "slave", &soft, &none, 0.5), None);
    }
}

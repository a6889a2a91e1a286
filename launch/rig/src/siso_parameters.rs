//! Parameters of the models of one channel that no plant simulates: an oscillator, a part tested by
//! itself, and those of a drive beyond the plant's.

use plant::{ParameterInfo, drive};

const fn info(
    name: &'static str,
    unit: &'static str,
    (minimum, maximum): (f64, f64),
    (printed, source): (f64, &'static str),
) -> ParameterInfo {
    ParameterInfo { name, unit, minimum, maximum, printed, source }
}

const EMPS: &str = "EMPS: Janot, Gautier, Brunot 2019";

/// Force of a drive's motor per volt; the input of [`plant::drive`] is that force.
pub(crate) const FORCE_PER_VOLT: [&str; 2] = ["force_per_volt_n", "torque_per_volt_nm"];

/// Travel of a drive per turn of its motor, from which effects periodic in its angle are
/// recognised.
pub(crate) const MOTOR_TURN: [&str; 2] = ["motor_turn_m", "motor_turn_rad"];

/// A drive's parameters beside those of [`plant::drive`]: its motor, and the rotary names.
const DRIVE: &[ParameterInfo] = &[
    info(FORCE_PER_VOLT[0], "N/V", (1e-6, 1e6), (35.15065, EMPS)),
    info(FORCE_PER_VOLT[1], "N m/V", (1e-9, 1e6), (1.0, "assumed")),
    info(MOTOR_TURN[0], "m", (1e-6, 1e3), (2.5e-3, EMPS)),
    info(MOTOR_TURN[1], "rad", (1e-6, 1e3), (std::f64::consts::TAU, "a motor without a gear")),
    info("inertia_kg_m2", "kg m^2", (1e-12, 1e6), (1e-3, "assumed")),
    info("viscous_friction_nm_s_per_rad", "N m s/rad", (0.0, 1e6), (0.0, "none")),
    info("torque_offset_nm", "N m", (-1e6, 1e6), (0.0, "none")),
];

/// The parameters of a drive.
pub(crate) fn of_drive() -> Vec<ParameterInfo> {
    [drive::Parameters::NAMES, DRIVE].concat()
}

/// Whether the name of a parameter of a model with one measured channel belongs to an axis in rad.
pub fn is_rotary(name: &str) -> bool {
    ["_nm", "_kg_m2", "_rad"].iter().any(|end| name.ends_with(end))
}

/// `mass ÿ + damping ẏ + stiffness y + offset = input`, input and output in volts.
pub(crate) const OSCILLATOR: &[ParameterInfo] = &[
    info("mass_s2", "s^2", (1e-18, 1e6), (5.17e-6, "Silverbox: natural frequency near 70 Hz")),
    info(
        "damping_s",
        "s",
        (0.0, 1e6),
        (2.3e-4, "Silverbox, assumed: a twentieth of critical damping"),
    ),
    info("stiffness", "1", (1e-9, 1e9), (1.0, "Silverbox: a volt holds about a volt")),
    info("coulomb_friction_v", "V", (0.0, 1e6), (0.0, "none")),
    info("input_offset_v", "V", (-1e6, 1e6), (0.0, "none")),
];

/// `stiffness x + damping v + offset = force`, linear or rotary.
pub(crate) const ELEMENT: &[ParameterInfo] = &[
    info("stiffness_n_per_m", "N/m", (1e-9, 1e12), (2e4, "assumed")),
    info("stiffness_nm_per_rad", "N m/rad", (1e-9, 1e12), (1.0, "assumed")),
    info("viscous_damping_n_s_per_m", "N s/m", (0.0, 1e9), (0.0, "none")),
    info("viscous_damping_nm_s_per_rad", "N m s/rad", (0.0, 1e9), (0.0, "none")),
    info("mass_kg", "kg", (0.0, 1e6), (0.0, "none")),
    info("inertia_kg_m2", "kg m^2", (0.0, 1e6), (0.0, "none")),
    info("coulomb_friction_n", "N", (0.0, 1e6), (0.0, "none")),
    info("coulomb_nm", "N m", (0.0, 1e6), (0.0, "none")),
    info("force_offset_n", "N", (-1e6, 1e6), (0.0, "none")),
    info("offset_nm", "N m", (-1e6, 1e6), (0.0, "none")),
];

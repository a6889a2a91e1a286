//! Parameters of the models of one channel that no plant simulates: an oscillator, and a part
//! tested by itself.

use plant::ParameterInfo;

const fn info(
    name: &'static str,
    unit: &'static str,
    (minimum, maximum): (f64, f64),
    (printed, source): (f64, &'static str),
) -> ParameterInfo {
    ParameterInfo { name, unit, minimum, maximum, printed, source }
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

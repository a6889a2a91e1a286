//! The constants of § 3.2.1, by name.

use crate::effects::LineConstants;
use crate::fluid::Pipe;
use crate::friction::Stribeck;
use crate::parameter::parameter_set;
use crate::transmission::{TransmissionParameters, least_damping};

parameter_set! {
    /// Constants of the hydrostatic transmission, SI.
    #[derive(PartialEq)]
    pub struct Parameters {
        /// Hose length `L`.
        hose_length_m: "m", 0.1, 50.0, 10.0, "§ 3.2.1";
        /// Hose diameter `d`, used in Re and Darcy only; it contradicts the area
        /// (`docs/errata.md`).
        hose_diameter_m: "m", 1e-3, 0.05, 0.009, "§ 3.2.1";
        /// Hose cross section `A`, used for stiffness, mass and area ratios.
        hose_area_m2: "m^2", 7e-7, 2e-3, 1.760e-4, "§ 3.2.1";
        /// Wall roughness of the hose; matters in turbulent flow only.
        hose_roughness_m: "m", 0.0, 1e-3, 1.5e-6, "assumed: drawn plastic tube";
        /// Bulk modulus `B`.
        bulk_modulus_pa: "Pa", 1e6, 1e10, 1.860e9, "§ 3.2.1";
        /// Dynamic viscosity `ν` (printed in N·s/m).
        fluid_viscosity_pa_s: "Pa s", 1e-5, 10.0, 8.470e-3, "§ 3.2.1, unit corrected";
        /// Density `ρ`.
        fluid_density_kg_m3: "kg/m^3", 1.0, 2e4, 847.0, "§ 3.2.1";
        /// Stiffness of the whole line over that of the fluid alone: 1 as printed, about 1/14 as
        /// traced.
        line_stiffness_factor: "1", 1e-6, 10.0, 1.0,
            "§ 3.2.2 neglects bulging, belts, entrained gas";
        /// Thickness of the hose's wall.
        hose_wall_m: "m", 1e-4, 0.1, 0.002, "assumed: not printed";
        /// Young's modulus of the hose's wall; infinite for a rigid one.
        hose_wall_modulus_pa: "Pa", 1e4, f64::INFINITY, f64::INFINITY, "§ 3.2.2 neglects bulging";
        /// Poisson's ratio of the hose's wall.
        hose_wall_poisson_ratio: "1", 0.0, 0.5, 0.4, "assumed: plastics";
        /// Stiffness of the belt between piston and pulley at either end; infinite for a rigid one.
        belt_stiffness_n_per_m: "N/m", 1.0, f64::INFINITY, f64::INFINITY,
            "§ 3.2.2 neglects the belts";
        /// Volume fraction of gas in the oil at the rest pressure.
        gas_fraction: "1", 0.0, 0.5, 0.0, "not mentioned";
        /// Exponent of the gas: 1 for slow, 1.4 for fast changes.
        gas_exponent: "1", 1.0, 1.67, 1.0, "assumed: isothermal";
        /// Absolute pressure of the line at rest.
        rest_pressure_pa: "Pa", 1e3, 1e8, 101_325.0, "assumed: not pressurised";
        /// Master pulley radius `r_mp`.
        master_pulley_radius_m: "m", 1e-3, 0.5, 0.031, "§ 3.2.1";
        /// Slave pulley radius `r_sp`.
        slave_pulley_radius_m: "m", 1e-3, 0.5, 0.034, "§ 3.2.1";
        /// Master cylinder area over hose area `α_m`.
        master_area_ratio: "1", 0.01, 500.0, 1.780, "§ 3.2.1";
        /// Slave cylinder area over hose area `α_s`.
        slave_area_ratio: "1", 0.01, 500.0, 1.900, "§ 3.2.1";
        /// Motor inertia `I`.
        motor_inertia_kg_m2: "kg m^2", 1e-6, 1.0, 2.500e-3, "§ 3.2.1";
        /// Master pulley inertia `I_mp`.
        master_pulley_inertia_kg_m2: "kg m^2", 0.0, 1.0, 4.500e-4, "§ 3.2.1";
        /// Slave pulley inertia `I_sp`.
        slave_pulley_inertia_kg_m2: "kg m^2", 0.0, 1.0, 1.270e-4, "§ 3.2.1";
        /// Inertia of the slave's hand fixture `I_sh`.
        slave_handle_inertia_kg_m2: "kg m^2", 1e-6, 1.0, 1.6e-3, "§ 3.2.1";
        /// Master piston mass `M_m`.
        master_piston_mass_kg: "kg", 0.0, 20.0, 0.239, "§ 3.2.1";
        /// Slave piston mass `M_s`.
        slave_piston_mass_kg: "kg", 0.0, 20.0, 0.254, "§ 3.2.1";
        /// Damping at the cylinder ports and bends, `D`.
        port_damping_n_s_per_m: "N s/m", 0.0, 1000.0, 0.3, "§ 3.2.1, tuned";
        /// Motor torque per volt.
        motor_torque_per_volt_nm: "N m/V", 0.01, 100.0, 1.8,
            "assumed: errata, 1.5 V against 2.74 N m";
        /// Motor Coulomb friction, constant part of `τ_mf`.
        motor_coulomb_nm: "N m", 0.0, 50.0, 0.767, "§ 3.2.1";
        /// Motor viscous friction, slope of `τ_mf`.
        motor_viscous_nm_s: "N m s/rad", 0.0, 10.0, 3.5e-4, "§ 3.2.1";
        /// Master piston friction `F_mf` at rest.
        master_piston_static_friction_n: "N", 0.0, 500.0, 0.200, "§ 3.2.1, tuned";
        /// Its fall per piston speed below the corner.
        master_piston_falling_slope_n_s_per_m: "N s/m", -1000.0, 1000.0, 0.200, "§ 3.2.1, tuned";
        /// Its corner, as a speed of the master pulley.
        master_piston_corner_speed_rad_s: "rad/s", 0.0, 1000.0, 6.0, "§ 3.2.1, tuned";
        /// Its value just above the corner.
        master_piston_kinetic_friction_n: "N", 0.0, 500.0, 0.240, "§ 3.2.1, tuned";
        /// Its rise per piston speed above the corner.
        master_piston_rising_slope_n_s_per_m: "N s/m", -1000.0, 1000.0, 0.200, "§ 3.2.1, tuned";
        /// Slave friction `τ_sf` at rest.
        slave_static_friction_nm: "N m", 0.0, 50.0, 2.30, "§ 3.2.1, tuned";
        /// Its fall per speed below the corner.
        slave_falling_slope_nm_s: "N m s/rad", -10.0, 10.0, 0.2, "§ 3.2.1, tuned";
        /// Its corner speed.
        slave_corner_speed_rad_s: "rad/s", 0.0, 1000.0, 6.0, "§ 3.2.1, tuned";
        /// Its value just above the corner.
        slave_kinetic_friction_nm: "N m", 0.0, 50.0, 1.10, "§ 3.2.1, tuned";
        /// Its rise per speed above the corner.
        slave_rising_slope_nm_s: "N m s/rad", -10.0, 10.0, 0.2, "§ 3.2.1, tuned";
        /// Speed over which dry friction is smoothed; 0 is exact stick.
        friction_smoothing_rad_s: "rad/s", 0.0, 10.0, 0.0, "0: exact stick; estimators may smooth";
        /// How it is smoothed: -1 a long approach, 0 a root, 1 a sharp corner
        /// ([`crate::friction::Smoothing`]).
        friction_smoothing_shape: "1", -1.0, 1.0, 0.0, "for estimators";
    }
}

/// How much softer the line is than its fluid alone, as traced: with it the model has the measured
/// 8 Hz.
const TRACED_STIFFNESS_FACTOR: f64 = 1.0 / 14.0;

impl Parameters {
    /// The constants as printed; where the print contradicts itself, as `docs/errata.md` says.
    pub fn printed() -> Self {
        Self::default()
    }

    /// As printed, but the line about 14 times softer: gives the frequency response measured on the
    /// rig (§ 5.2.3).
    pub fn calibrated() -> Self {
        Self { line_stiffness_factor: TRACED_STIFFNESS_FACTOR, ..Self::default() }
    }

    /// The same machine with another hose: the bore sets area and diameter, the cylinders stay (so
    /// that α changes).
    #[must_use]
    pub fn with_hose_diameter(self, diameter_m: f64) -> Self {
        let area = 0.25 * std::f64::consts::PI * diameter_m * diameter_m;
        Self {
            hose_diameter_m: diameter_m,
            hose_area_m2: area,
            master_area_ratio: self.master_area_ratio * self.hose_area_m2 / area,
            slave_area_ratio: self.slave_area_ratio * self.hose_area_m2 / area,
            ..self
        }
    }

    /// The same machine with a longer or shorter hose, m.
    #[must_use]
    pub fn with_hose_length(self, length_m: f64) -> Self {
        Self { hose_length_m: length_m, ..self }
    }

    /// Stiffness of one line, N/m: `K = B A / L` (eq. 3.1.7) times the line's factor, with wall,
    /// gas and belts in series.
    pub fn line_stiffness_n_per_m(&self) -> f64 {
        let [master, slave] = self.half_line_stiffness_n_per_m();
        master * slave / (master + slave)
    }

    /// Mass of the fluid in one line `m_l = A L ρ`, kg.
    pub fn fluid_mass_kg(&self) -> f64 {
        self.hose_area_m2 * self.hose_length_m * self.fluid_density_kg_m3
    }

    /// `I_m` of eq. 3.1.13, kg·m².
    pub fn master_inertia_kg_m2(&self) -> f64 {
        self.motor_inertia_kg_m2
            + self.master_pulley_inertia_kg_m2
            + self.master_piston_mass_kg * self.master_pulley_radius_m.powi(2)
    }

    /// `I_s` of eq. 3.1.13, kg·m².
    pub fn slave_inertia_kg_m2(&self) -> f64 {
        self.slave_handle_inertia_kg_m2
            + self.slave_pulley_inertia_kg_m2
            + self.slave_piston_mass_kg * self.slave_pulley_radius_m.powi(2)
    }

    /// Fluid displacement in the hose per master angle `α_m r_mp`, m/rad.
    pub fn master_displacement_m_per_rad(&self) -> f64 {
        self.master_area_ratio * self.master_pulley_radius_m
    }

    /// Fluid displacement in the hose per slave angle `α_s r_sp`, m/rad.
    pub fn slave_displacement_m_per_rad(&self) -> f64 {
        self.slave_area_ratio * self.slave_pulley_radius_m
    }

    /// Slave angle per master angle with a rigid line.
    pub fn transmission_ratio(&self) -> f64 {
        self.master_displacement_m_per_rad() / self.slave_displacement_m_per_rad()
    }

    /// Breakaway torque at the motor when the slave is to move, N·m: `0.767 + 0.2·0.031 +
    /// 2.30·0.854 = 2.74` as printed.
    pub fn static_friction_at_motor_nm(&self) -> f64 {
        self.motor_coulomb_nm
            + self.master_piston_static_friction_n * self.master_pulley_radius_m
            + self.slave_static_friction_nm * self.transmission_ratio()
    }

    /// Loss in one hose.
    pub fn pipe(&self) -> Pipe {
        Pipe::new(
            self.hose_length_m,
            self.hose_diameter_m,
            self.hose_area_m2,
            self.hose_roughness_m,
            self.fluid_viscosity_pa_s,
            self.fluid_density_kg_m3,
        )
    }

    /// Master piston friction as a torque on the master pulley, `r_mp F_mf`, over pulley speed.
    pub fn master_piston_friction(&self) -> Stribeck {
        let radius = self.master_pulley_radius_m;
        Stribeck {
            at_rest: self.master_piston_static_friction_n * radius,
            falling: self.master_piston_falling_slope_n_s_per_m * radius * radius,
            corner: self.master_piston_corner_speed_rad_s,
            above_corner: self.master_piston_kinetic_friction_n * radius,
            rising: self.master_piston_rising_slope_n_s_per_m * radius * radius,
        }
    }

    /// Slave friction `τ_sf` over slave speed.
    pub fn slave_friction(&self) -> Stribeck {
        Stribeck {
            at_rest: self.slave_static_friction_nm,
            falling: self.slave_falling_slope_nm_s,
            corner: self.slave_corner_speed_rad_s,
            above_corner: self.slave_kinetic_friction_nm,
            rising: self.slave_rising_slope_nm_s,
        }
    }
}

impl LineConstants for Parameters {
    fn model(&self) -> &'static str {
        "hydrostatic transmission"
    }

    fn line_stiffness_n_per_m(&self) -> f64 {
        Self::line_stiffness_n_per_m(self)
    }

    fn line_mass_kg(&self) -> f64 {
        self.fluid_mass_kg()
    }

    fn fluid_area_m2(&self) -> Option<f64> {
        Some(self.hose_area_m2)
    }

    fn scale_line_stiffness(&mut self, factor: f64) {
        self.line_stiffness_factor *= factor;
    }

    fn add_line_damping(&mut self, damping_n_s_per_m: f64) {
        self.port_damping_n_s_per_m += damping_n_s_per_m;
    }
}

impl TransmissionParameters for Parameters {
    fn motor_torque_per_volt_nm(&self) -> f64 {
        self.motor_torque_per_volt_nm
    }

    fn inertia_kg_m2(&self) -> [f64; 2] {
        [self.master_inertia_kg_m2(), Self::slave_inertia_kg_m2(self)]
    }

    fn middle_mass_kg(&self) -> f64 {
        self.fluid_mass_kg()
    }

    fn displacement_m_per_rad(&self) -> [f64; 2] {
        [Self::master_displacement_m_per_rad(self), self.slave_displacement_m_per_rad()]
    }

    fn half_line_stiffness_n_per_m(&self) -> [f64; 2] {
        Self::half_line_stiffness_n_per_m(self)
    }

    fn link_damping_n_s_per_m(&self) -> f64 {
        self.port_damping_n_s_per_m
    }

    fn linear_damping(&self, speed_max: f64) -> [f64; 3] {
        [
            self.motor_viscous_nm_s,
            least_damping(speed_max, |speed| self.slave_friction().level(speed)),
            2.0 * self.pipe().coefficient(0.0),
        ]
    }

    fn transmission_ratio(&self) -> f64 {
        Self::transmission_ratio(self)
    }

    fn friction_at_motor_nm(&self, motor_rad_s: f64, line_share: f64) -> [f64; 2] {
        let piston = self.master_piston_friction().level(motor_rad_s);
        let (ratio, displacement) =
            (Self::transmission_ratio(self), Self::master_displacement_m_per_rad(self));
        // Fluid friction acts along the whole line; the model has it in the middle.
        let fluid = displacement * motor_rad_s;
        let loss = 2.0 * displacement * self.pipe().coefficient(fluid) * fluid;
        let slave = self.slave_friction().level(ratio * motor_rad_s);
        [
            self.motor_coulomb_nm + self.motor_viscous_nm_s * motor_rad_s + piston,
            ratio * slave + line_share * loss,
        ]
    }

    fn handle_inertia(&self) -> &'static str {
        "slave_handle_inertia_kg_m2"
    }

    fn slave_friction_parameters(&self, dry_nm: f64, viscous: f64) -> Vec<(&'static str, f64)> {
        // The rising branch counts from the corner.
        vec![
            ("slave_static_friction_nm", dry_nm),
            ("slave_kinetic_friction_nm", dry_nm + viscous * self.slave_corner_speed_rad_s),
            ("slave_falling_slope_nm_s", -viscous),
            ("slave_rising_slope_nm_s", viscous),
        ]
    }
}

//! The constants of chapter 5, by name, and those that it does not print.

use super::{Element, ElementLaw};
use crate::effects::LineConstants;
use crate::friction::StribeckCurve;
use crate::parameter::parameter_set;
use crate::transmission::{TransmissionParameters, least_damping};

parameter_set! {
    /// Constants of the cable transmission, SI.
    #[derive(PartialEq)]
    pub struct Parameters {
        /// Length of the transmission: of each of the two cables (18 m in all).
        line_length_m: "m", 0.1, 100.0, 9.0, "§ 5.1";
        /// Distance between supports: one tube.
        support_spacing_m: "m", 0.05, 20.0, 3.0, "§ 5.1";
        /// Cable diameter.
        cable_diameter_m: "m", 1e-4, 0.02, 1e-3, "§ 5.1";
        /// Stiffness of one cable of 9 m, `K`; scales with 1/length and with the section.
        cable_stiffness_n_per_m: "N/m", 10.0, 1e7, 3.725e4, "§ 5.2.1, fig. 5.3";
        /// Stiffness in place over that: 1 as printed, too stiff for kevlar (`docs/errata.md`).
        cable_stiffness_factor: "1", 1e-4, 10.0, 1.0, "§ 5.2.1 taken at its word; errata";
        /// Parallel cables in each direction.
        cables: "1", 1.0, 64.0, 1.0, "§ 5.1; ch. 6 asks for more";
        /// Tension at which the toe ends.
        toe_tension_n: "N", 0.0, 100.0, 0.37, "fig. 5.3: fit from 0.02 mm; 3.725e4 · 2e-5 / 2";
        /// Permanent set over elastic elongation on first loading.
        set_ratio: "1", 0.0, 5.0, 0.25, "assumed: fig. 5.4 has no numbers in the text";
        /// Tension to which the cable was loaded before.
        bedding_tension_n: "N", 0.0, 5000.0, 200.0, "assumed: above any tension at work";
        /// Friction between fibres over tension.
        fibre_friction_ratio: "1", 0.0, 0.5, 0.05, "assumed: fig. 5.4 has no numbers in the text";
        /// Stiffness of that friction's branch over the cable's.
        fibre_branch_ratio: "1", 0.0, 10.0, 0.2, "assumed";
        /// Mass of one cable per length.
        cable_mass_kg_per_m: "kg/m", 1e-6, 1.0, 7.9e-4,
            "assumed: 1440 kg/m³ · 0.785 mm² · 0.7 filled";
        /// Gravity along which the cable sags; 0 for a cable without sag.
        gravity_m_s2: "m/s^2", 0.0, 20.0, 9.81, "standard gravity";
        /// Tension of each cable at rest.
        pretension_n: "N", 0.1, 2000.0, 60.0,
            "assumed: half of 47 N friction + 41 N inertia at 8 Hz, and a third more";
        /// Damping of each half of a cable.
        cable_damping_n_s_per_m: "N s/m", 0.0, 1000.0, 0.6,
            "assumed: loss factor 0.02 of half a cable (1.5e3 N/m) at 8 Hz";
        /// Radius of the master's pulley.
        master_pulley_radius_m: "m", 1e-3, 0.5, 0.010,
            "assumed: two runs 20 mm apart in a tube 34 mm wide inside";
        /// Master angle per slave angle.
        mechanical_ratio: "1", 0.05, 50.0, 6.0, "§ 5.2.3, about 6";
        /// Inertia of motor and master pulley.
        master_inertia_kg_m2: "kg m^2", 1e-7, 1.0, 4.4e-4,
            "assumed: disc rotor, 0.35 kg, radius 50 mm";
        /// Inertia of slave pulley, torque cell and handle.
        slave_inertia_kg_m2: "kg m^2", 1e-6, 1.0, 1.89e-3,
            "assumed: handle of § 3.2.1, 1.6e-3, and POM disc of 60 mm radius, 10 mm thick, 2.9e-4";
        /// Mass of one support's pulley as the cable feels it.
        support_mass_kg: "kg", 0.0, 1.0, 1.1e-3,
            "assumed: half of a POM disc of 10 mm radius, 5 mm thick";
        /// Motor torque per volt.
        motor_torque_per_volt_nm: "N m/V", 0.001, 100.0, 0.3,
            "assumed: 10 V for 3 N m, six times the friction";
        /// Dry friction of the motor itself.
        motor_coulomb_nm: "N m", 0.0, 50.0, 0.05,
            "assumed: a tenth of § 5.2.2; § 5.3 has most at the supports";
        /// Viscous friction of the motor.
        motor_viscous_nm_s: "N m s/rad", 0.0, 10.0, 3.5e-4, "assumed: as in § 3.2.1";
        /// Dry friction of the slave's bearing.
        slave_bearing_nm: "N m", 0.0, 50.0, 0.1, "assumed: 0.017 N m at the motor";
        /// Friction of one cable at one support, saturated.
        support_friction_limit_n: "N", 0.0, 1e5, 10.2,
            "§ 5.2.2: (0.475 - 0.05 - 0.1/6) N m / 10 mm over 8 supports, at half saturation";
        /// Tension at which it is half saturated.
        support_half_tension_n: "N", 0.01, 1e5, 60.0,
            "assumed: fig. 5.6 bends within the range used";
        /// Friction in movement over that at rest.
        kinetic_friction_ratio: "1", 0.0, 1.0, 0.48, "assumed: 1.10/2.30 as in § 3.2.1";
        /// Cable speed over which it falls.
        stribeck_speed_m_s: "m/s", 1e-4, 100.0, 0.18,
            "assumed: half of § 3.2.1's 6 rad/s at the slave";
        /// Half the difference between the directions, over the mean; positive for more forward.
        friction_asymmetry: "1", -1.0, 1.0, 0.061,
            "§ 5.2.2: 0.025 N m of 0.408 N m at the supports";
        /// Variation of the supports' friction along the stroke.
        friction_position_amplitude: "1", 0.0, 1.0, 0.1,
            "assumed: fig. 5.5, less than the hydrostatic's";
        /// Its angle per cable displacement.
        friction_position_order_rad_per_m: "rad/m", 0.0, 1e4, 100.0,
            "assumed: support pulleys of 10 mm radius";
        /// Viscous friction of one support.
        support_viscous_n_s_per_m: "N s/m", 0.0, 1000.0, 0.0, "assumed: dry bearing";
    }
}

/// Length for which § 5.2.1 gives the stiffness, m.
const MEASURED_LENGTH_M: f64 = 9.0;
/// Diameter for which it does, m.
const MEASURED_DIAMETER_M: f64 = 1e-3;
/// Stiffness in place over the printed: with it the response peaks at the measured 8 Hz.
const TRACED_STIFFNESS_FACTOR: f64 = 1.0 / 36.0;

impl Parameters {
    /// The constants as printed, the rest assumed.
    pub fn printed() -> Self {
        Self::default()
    }

    /// As printed, but the cables softer, so that the response peaks at the measured 8 Hz (§
    /// 5.2.3).
    pub fn calibrated() -> Self {
        Self { cable_stiffness_factor: TRACED_STIFFNESS_FACTOR, ..Self::default() }
    }

    /// Stiffness of all parallel cables of one direction from end to end, aligned and without sag,
    /// N/m.
    pub fn line_stiffness_n_per_m(&self) -> f64 {
        self.cables * self.single_cable_n_per_m()
    }

    fn single_cable_n_per_m(&self) -> f64 {
        let section = (self.cable_diameter_m / MEASURED_DIAMETER_M).powi(2);
        self.cable_stiffness_factor * self.cable_stiffness_n_per_m * section * MEASURED_LENGTH_M
            / self.line_length_m
    }

    /// The law of a piece of one cable of `length_m`.
    pub fn element_law(&self, length_m: f64) -> ElementLaw {
        ElementLaw {
            stiffness_n_per_m: self.single_cable_n_per_m() * self.line_length_m / length_m,
            toe_tension_n: self.toe_tension_n,
            sag_n2_m: ElementLaw::sag_constant(
                length_m / self.support_spacing_m,
                self.support_spacing_m.min(length_m),
                self.cable_mass_kg_per_m * self.gravity_m_s2,
            ),
            set_ratio: self.set_ratio,
            branch_ratio: self.fibre_branch_ratio,
            friction_ratio: self.fibre_friction_ratio,
        }
    }

    /// A new piece of cable on a testing machine, without sag: for figs. 5.3 and 5.4.
    pub fn specimen(&self, length_m: f64) -> Element {
        Element::new(ElementLaw { sag_n2_m: 0.0, ..self.element_law(length_m) })
    }

    /// Radius of the slave's pulley, m.
    pub fn slave_pulley_radius_m(&self) -> f64 {
        self.mechanical_ratio * self.master_pulley_radius_m
    }

    /// Slave angle per master angle with a rigid line.
    pub fn transmission_ratio(&self) -> f64 {
        1.0 / self.mechanical_ratio
    }

    /// Supports of one cable: both ends and the joints between.
    pub fn supports(&self) -> f64 {
        (self.line_length_m / self.support_spacing_m).round().max(1.0) + 1.0
    }

    /// Mass of one line's middle, kg: half its cables, and the supports between the ends.
    pub fn middle_mass_kg(&self) -> f64 {
        let cable = 0.5 * self.line_length_m * self.cable_mass_kg_per_m;
        self.cables * (cable + (self.supports() - 2.0) * self.support_mass_kg).max(1e-6)
    }

    /// Mass at each end of one line, kg: a quarter of its cables, and one support.
    pub fn end_mass_kg(&self) -> f64 {
        self.cables * (0.25 * self.line_length_m * self.cable_mass_kg_per_m + self.support_mass_kg)
    }

    /// Inertia of the master with what moves with it, kg·m².
    pub fn total_master_inertia_kg_m2(&self) -> f64 {
        self.master_inertia_kg_m2 + 2.0 * self.end_mass_kg() * self.master_pulley_radius_m.powi(2)
    }

    /// Inertia of the slave with what moves with it, kg·m².
    pub fn total_slave_inertia_kg_m2(&self) -> f64 {
        self.slave_inertia_kg_m2 + 2.0 * self.end_mass_kg() * self.slave_pulley_radius_m().powi(2)
    }

    /// Breakaway friction of one line's cables at one support under the line's tension, N; mean of
    /// both directions and of all positions.
    #[inline]
    pub fn support_friction_n(&self, line_tension_n: f64) -> f64 {
        let tension = line_tension_n.max(0.0) / self.cables;
        self.cables * self.support_friction_limit_n * tension
            / (tension + self.support_half_tension_n)
    }

    /// Breakaway torque at the motor when the slave is to move, all cables at pretension, N·m.
    pub fn static_friction_at_motor_nm(&self) -> f64 {
        let supports =
            2.0 * self.supports() * self.support_friction_n(self.cables * self.pretension_n);
        self.motor_coulomb_nm
            + supports * self.master_pulley_radius_m
            + self.slave_bearing_nm / self.mechanical_ratio
    }
}

impl LineConstants for Parameters {
    fn model(&self) -> &'static str {
        "cable transmission"
    }

    fn line_stiffness_n_per_m(&self) -> f64 {
        Self::line_stiffness_n_per_m(self)
    }

    fn line_mass_kg(&self) -> f64 {
        self.middle_mass_kg() + 2.0 * self.end_mass_kg()
    }

    fn fluid_area_m2(&self) -> Option<f64> {
        None
    }

    fn scale_line_stiffness(&mut self, factor: f64) {
        self.cable_stiffness_factor *= factor;
    }

    fn add_line_damping(&mut self, damping_n_s_per_m: f64) {
        self.cable_damping_n_s_per_m += damping_n_s_per_m;
    }
}

impl TransmissionParameters for Parameters {
    fn motor_torque_per_volt_nm(&self) -> f64 {
        self.motor_torque_per_volt_nm
    }

    fn inertia_kg_m2(&self) -> [f64; 2] {
        [self.total_master_inertia_kg_m2(), self.total_slave_inertia_kg_m2()]
    }

    fn middle_mass_kg(&self) -> f64 {
        Self::middle_mass_kg(self)
    }

    fn displacement_m_per_rad(&self) -> [f64; 2] {
        [self.master_pulley_radius_m, self.slave_pulley_radius_m()]
    }

    fn half_line_stiffness_n_per_m(&self) -> [f64; 2] {
        [2.0 * Self::line_stiffness_n_per_m(self); 2]
    }

    fn link_damping_n_s_per_m(&self) -> f64 {
        self.cables * self.cable_damping_n_s_per_m
    }

    fn linear_damping(&self, speed_max: f64) -> [f64; 3] {
        let (master, slave) = (self.master_pulley_radius_m, self.slave_pulley_radius_m());
        let viscous = self.cables * self.support_viscous_n_s_per_m;
        let inner = (self.supports() - 2.0).max(0.0);
        [
            self.motor_viscous_nm_s + 2.0 * viscous * master * master,
            2.0 * viscous * slave * slave + least_damping(speed_max, |_| self.slave_bearing_nm),
            2.0 * viscous * inner,
        ]
    }

    fn transmission_ratio(&self) -> f64 {
        Self::transmission_ratio(self)
    }

    fn friction_at_motor_nm(&self, motor_rad_s: f64, line_share: f64) -> [f64; 2] {
        let radius = self.master_pulley_radius_m;
        let support = self.support_friction_n(self.cables * self.pretension_n);
        let falling = StribeckCurve {
            kinetic: self.kinetic_friction_ratio,
            breakaway: 1.0,
            speed: self.stribeck_speed_m_s,
            exponent: 1.0,
        };
        let viscous = self.cables * self.support_viscous_n_s_per_m;
        let speed = radius * motor_rad_s;
        // Of each of the two lines, one support is at the master, one at the slave, and the model
        // has the others in the middle.
        let supports = 2.0 * radius * (support * falling.level(speed) + viscous * speed);
        let along = 1.0 + line_share * (self.supports() - 2.0);
        [
            self.motor_coulomb_nm + self.motor_viscous_nm_s * motor_rad_s + supports,
            along * supports + Self::transmission_ratio(self) * self.slave_bearing_nm,
        ]
    }

    fn handle_inertia(&self) -> &'static str {
        "slave_inertia_kg_m2"
    }

    fn slave_friction_parameters(&self, dry_nm: f64, _viscous: f64) -> Vec<(&'static str, f64)> {
        vec![("slave_bearing_nm", dry_nm)]
    }
}

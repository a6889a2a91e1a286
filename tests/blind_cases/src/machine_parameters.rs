//! Parameters of a simulated machine: those of § 3.2.1 as the rig file `hydrostatic.toml` declares
//! them, and derived ones (equations of chapter 3). Each differs from its declared value by a
//! log-normal factor within its tolerance.

use std::collections::BTreeMap;

use crate::random::Draw;

macro_rules! machine {
    ($($name:ident $unit:literal $value:literal $tolerance:literal;)+) => {
        /// Constants of one machine; units in the names, signs and meaning as in the rig file.
        #[derive(Clone, Debug, PartialEq)]
        #[expect(missing_docs, reason = "the names are those of the rig file, which explains them")]
        pub struct MachineParameters { $(pub $name: f64,)+ }

        impl MachineParameters {
            /// As declared.
            pub fn declared() -> Self { Self { $($name: $value,)+ } }

            /// Each constant times a log-normal factor: its tolerance (0.25 at most) is two
            /// standard deviations, at which the factor is clipped.
            pub fn drawn(draw: &mut Draw) -> Self {
                let mut machine = Self::declared();
                $(machine.$name *= factor(draw, $tolerance);)+
                machine.join_friction();
                machine
            }

            /// Each constant anywhere within its tolerance, one in four at its edge.
            pub fn drawn_to_the_edge(draw: &mut Draw) -> Self {
                let mut machine = Self::declared();
                $(machine.$name *= factor_to_the_edge(draw, $tolerance);)+
                machine.join_friction();
                machine
            }

            /// All constants by name.
            pub fn named(&self) -> BTreeMap<String, f64> {
                [$((stringify!($name).to_owned(), self.$name),)+].into()
            }

            /// The constant of that name, to be changed.
            pub fn named_mut(&mut self, name: &str) -> Option<&mut f64> {
                match name {
                    $(stringify!($name) => Some(&mut self.$name),)+
                    _ => None,
                }
            }
        }

        /// Name, declared value, tolerance as a fraction (0: not declared in the rig file, kept),
        /// unit.
        pub const DECLARED: &[(&str, f64, f64, &str)] =
            &[$((stringify!($name), $value, $tolerance, $unit),)+];
    };
}

machine! {
    hose_length_m "m" 10.0 0.01;
    hose_area_m2 "m^2" 1.760e-4 0.05;
    hose_diameter_m "m" 0.009 0.05;
    hose_roughness_m "m" 1.5e-6 0.0;
    bulk_modulus_pa "Pa" 1.860e9 0.05;
    fluid_density_kg_m3 "kg/m^3" 847.0 0.02;
    fluid_viscosity_pa_s "Pa s" 8.470e-3 0.25;
    line_stiffness_factor "1" 0.0714285714 0.25;
    port_damping_n_s_per_m "N s/m" 0.3 0.5;
    master_pulley_radius_m "m" 0.031 0.02;
    master_area_ratio "1" 1.780 0.05;
    motor_inertia_kg_m2 "kg m^2" 2.500e-3 0.05;
    master_pulley_inertia_kg_m2 "kg m^2" 4.500e-4 0.10;
    master_piston_mass_kg "kg" 0.239 0.05;
    motor_torque_per_volt_nm "N m/V" 1.8 0.25;
    motor_coulomb_nm "N m" 0.767 0.25;
    motor_viscous_nm_s "N m s/rad" 3.5e-4 0.5;
    master_piston_static_friction_n "N" 0.200 0.5;
    master_piston_falling_slope_n_s_per_m "N s/m" 0.200 0.0;
    master_piston_corner_speed_rad_s "rad/s" 6.0 0.0;
    master_piston_kinetic_friction_n "N" 0.240 0.5;
    master_piston_rising_slope_n_s_per_m "N s/m" 0.200 0.0;
    slave_pulley_radius_m "m" 0.034 0.02;
    slave_area_ratio "1" 1.900 0.05;
    slave_pulley_inertia_kg_m2 "kg m^2" 1.270e-4 0.10;
    slave_handle_inertia_kg_m2 "kg m^2" 1.6e-3 0.10;
    slave_piston_mass_kg "kg" 0.254 0.05;
    slave_static_friction_nm "N m" 2.30 0.25;
    slave_kinetic_friction_nm "N m" 1.10 0.25;
    slave_falling_slope_nm_s "N m s/rad" 0.2 0.25;
    slave_rising_slope_nm_s "N m s/rad" 0.2 0.25;
    slave_corner_speed_rad_s "rad/s" 6.0 0.0;
}

/// Largest relative deviation of a constant, whatever its tolerance.
const LARGEST_DEVIATION: f64 = 0.25;

fn factor(draw: &mut Draw, tolerance: f64) -> f64 {
    let reach = tolerance.min(LARGEST_DEVIATION);
    (0.5 * reach * draw.normal()).exp().clamp(1.0 - reach, 1.0 + reach)
}

fn factor_to_the_edge(draw: &mut Draw, tolerance: f64) -> f64 {
    let within = draw.uniform(-1.0, 1.0);
    let at_edge = draw.sign() * draw.uniform(0.95, 1.0);
    1.0 + tolerance * if draw.below(4) == 0 { at_edge } else { within }
}

impl MachineParameters {
    /// Friction of a real slave is continuous at the corner speed: the falling slope leads to the
    /// kinetic value as far as its tolerance permits.
    fn join_friction(&mut self) {
        let slope = (self.slave_static_friction_nm - self.slave_kinetic_friction_nm)
            / self.slave_corner_speed_rad_s;
        self.slave_falling_slope_nm_s = slope.clamp(0.15, 0.25);
    }

    /// Stiffness `K = B A / L` of one line (eq. 3.1.7), softened, N/m; each half is a spring of
    /// `2K`.
    pub fn line_stiffness_n_per_m(&self) -> f64 {
        self.line_stiffness_factor * self.bulk_modulus_pa * self.hose_area_m2 / self.hose_length_m
    }

    /// Mass of the fluid in one line, kg.
    pub fn fluid_mass_kg(&self) -> f64 {
        self.hose_area_m2 * self.hose_length_m * self.fluid_density_kg_m3
    }

    /// `I_m` and `I_s` of eq. 3.1.13, kg·m².
    pub fn inertia_kg_m2(&self) -> [f64; 2] {
        [
            self.motor_inertia_kg_m2
                + self.master_pulley_inertia_kg_m2
                + self.master_piston_mass_kg * self.master_pulley_radius_m.powi(2),
            self.slave_handle_inertia_kg_m2
                + self.slave_pulley_inertia_kg_m2
                + self.slave_piston_mass_kg * self.slave_pulley_radius_m.powi(2),
        ]
    }

    /// Fluid displacement in the hose per angle of master and slave, `α r`, m/rad.
    pub fn displacement_m_per_rad(&self) -> [f64; 2] {
        [
            self.master_area_ratio * self.master_pulley_radius_m,
            self.slave_area_ratio * self.slave_pulley_radius_m,
        ]
    }

    /// Dry friction on the master at a speed (rad/s): motor and piston, N·m.
    pub fn master_friction_nm(&self, speed: f64) -> f64 {
        let radius = self.master_pulley_radius_m;
        let piston = if speed < self.master_piston_corner_speed_rad_s {
            self.master_piston_static_friction_n
                - self.master_piston_falling_slope_n_s_per_m * speed * radius
        } else {
            let beyond = speed - self.master_piston_corner_speed_rad_s;
            self.master_piston_kinetic_friction_n
                + self.master_piston_rising_slope_n_s_per_m * beyond * radius
        };
        self.motor_coulomb_nm + radius * piston.max(0.0)
    }

    /// Dry friction on the slave at a speed (rad/s), N·m.
    pub fn slave_friction_nm(&self, speed: f64) -> f64 {
        let friction = if speed < self.slave_corner_speed_rad_s {
            self.slave_static_friction_nm - self.slave_falling_slope_nm_s * speed
        } else {
            self.slave_kinetic_friction_nm
                + self.slave_rising_slope_nm_s * (speed - self.slave_corner_speed_rad_s)
        };
        friction.max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drawn_constants_differ_within_their_tolerances() {
        for seed in 0..200 {
            let machine = MachineParameters::drawn(&mut Draw::new(seed)).named();
            for (name, value, tolerance, _) in DECLARED {
                let off = machine[*name] / value - 1.0;
                assert!(off.abs() <= tolerance + 1e-12, "{name}: {off}");
                assert_eq!(off == 0.0, *tolerance == 0.0, "{name} of seed {seed}: {off}");
            }
        }
    }

    #[test]
    fn constants_at_the_edge_stay_within() {
        let mut at_edge = 0;
        for seed in 0..100 {
            let machine = MachineParameters::drawn_to_the_edge(&mut Draw::new(seed)).named();
            for (name, value, tolerance, _) in DECLARED {
                let off = (machine[*name] / value - 1.0).abs();
                assert!(off <= tolerance + 1e-12, "{name}: {off}");
                at_edge += usize::from(*tolerance > 0.0 && off >= 0.95 * tolerance);
            }
        }
        let varied = DECLARED.iter().filter(|row| row.2 > 0.0).count() * 100;
        assert!((varied / 5..varied / 2).contains(&at_edge), "{at_edge} of {varied}");
    }

    /// The table above is the rig file's.
    #[test]
    fn declared_as_in_the_rig_file() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../launch/rigs/hydrostatic.toml");
        let rig: toml::Table = std::fs::read_to_string(path).unwrap().parse().unwrap();
        let parameters = rig["model"]["parameters"].as_table().unwrap();
        for (name, entry) in parameters {
            let found = DECLARED
                .iter()
                .find(|row| row.0 == name)
                .unwrap_or_else(|| panic!("{name} is not here"));
            assert_eq!(found.1, entry["value"].as_float().unwrap(), "{name}");
            assert_eq!(found.2, entry["tolerance"].as_float().unwrap(), "{name}");
        }
        assert_eq!(parameters.len(), DECLARED.iter().filter(|row| row.2 > 0.0).count());
    }
}

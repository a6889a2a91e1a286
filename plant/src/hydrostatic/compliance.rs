//! Compliance of a line beyond that of its fluid: hose wall, belts, entrained gas. § 3.2.2 neglects
//! all three.
//!
//! The line's stiffness is `K = B A / L` (eq. 3.1.7). Compliances in series add up:
//!
//! - the hose wall: the bore expands under pressure, which acts like a fluid of modulus `B_w` in
//!   series with the oil, `1/B' = 1/B + 1/B_w`. For a tube with open ends (the hose lies loose, and
//!   its ends carry the thrust) Lamé's radial displacement,
//!   `u = (p r_i/E) [ν + (r_o² + r_i²)/(r_o² - r_i²)]`, gives `B_w = p A/ΔA = p r_i/(2u)`; for a
//!   thin wall that is `E t/d`, Korteweg's formula (Timoshenko and Goodier, Theory of Elasticity, §
//!   28);
//! - entrained gas: a volume fraction `φ` at the absolute pressure `p` adds `φ/(n p)`, with `n = 1`
//!   for slow (isothermal) and up to 1.4 for fast (adiabatic) changes (Merritt, Hydraulic Control
//!   Systems, 1967, § 2.3);
//! - the belts: one at each end, of stiffness `k_b` between piston and pulley. Seen from the hose,
//!   where forces are smaller by α and displacements larger by α, that is `k_b/α²`, in series with
//!   the half line `2K` of its end.

use std::f64::consts::PI;

use super::Parameters;

/// Bulk modulus of a fluid that is as compliant as the wall of a tube, Pa (see the module
/// documentation). Infinite for a rigid wall.
pub fn wall_bulk_modulus_pa(
    inner_diameter_m: f64,
    wall_m: f64,
    youngs_modulus_pa: f64,
    poisson_ratio: f64,
) -> f64 {
    let inner = 0.5 * inner_diameter_m;
    let outer = inner + wall_m;
    let lame = (outer * outer + inner * inner) / (outer * outer - inner * inner) + poisson_ratio;
    youngs_modulus_pa / (2.0 * lame)
}

/// Values of single causes, each of which alone would explain a softened line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Explanations {
    /// Young's modulus of the hose wall, Pa.
    pub wall_modulus_pa: f64,
    /// Stiffness of each belt, N/m.
    pub belt_stiffness_n_per_m: f64,
    /// Volume fraction of gas at the rest pressure, slow changes.
    pub gas_fraction: f64,
    /// The bulk modulus, if it is misprinted and nothing else is compliant, Pa.
    pub bulk_modulus_pa: f64,
}

impl Parameters {
    /// Bore that corresponds to the area of the hose, m; `hose_diameter_m` contradicts it
    /// (`docs/errata.md`).
    pub fn bore_m(&self) -> f64 {
        (4.0 * self.hose_area_m2 / PI).sqrt()
    }

    /// Modulus of fluid, wall and gas in series, Pa.
    pub fn effective_bulk_modulus_pa(&self) -> f64 {
        let wall = wall_bulk_modulus_pa(
            self.bore_m(),
            self.hose_wall_m,
            self.hose_wall_modulus_pa,
            self.hose_wall_poisson_ratio,
        );
        let gas = self.gas_fraction / (self.gas_exponent * self.rest_pressure_pa);
        1.0 / ((1.0 - self.gas_fraction) / self.bulk_modulus_pa + 1.0 / wall + gas)
    }

    /// Stiffness of the half line between a piston and the middle of the hose, `2K` with all
    /// compliances, N/m: at the master's and at the slave's end.
    pub fn half_line_stiffness_n_per_m(&self) -> [f64; 2] {
        let hose =
            2.0 * self.line_stiffness_factor * self.effective_bulk_modulus_pa() * self.hose_area_m2
                / self.hose_length_m;
        [self.master_area_ratio, self.slave_area_ratio]
            .map(|ratio| 1.0 / (1.0 / hose + ratio * ratio / self.belt_stiffness_n_per_m))
    }

    /// Values of single causes, each of which alone softens the line from the stiffness of the
    /// fluid by `factor` (below 1). NaN for causes that cannot.
    pub fn explain_softening(&self, factor: f64) -> Explanations {
        let missing = (1.0 / factor - 1.0) / self.bulk_modulus_pa;
        let positive = |value: f64| if value > 0.0 && value.is_finite() { value } else { f64::NAN };
        let unit_wall = wall_bulk_modulus_pa(
            self.bore_m(),
            self.hose_wall_m,
            1.0,
            self.hose_wall_poisson_ratio,
        );
        let gas_pressure = self.gas_exponent * self.rest_pressure_pa;
        // The mean of α² over both ends.
        let square = 0.5 * (self.master_area_ratio.powi(2) + self.slave_area_ratio.powi(2));
        let half = 2.0 * self.bulk_modulus_pa * self.hose_area_m2 / self.hose_length_m;
        Explanations {
            wall_modulus_pa: positive(1.0 / (missing * unit_wall)),
            belt_stiffness_n_per_m: positive(half * square * factor / (1.0 - factor)),
            gas_fraction: positive(missing / (1.0 / gas_pressure - 1.0 / self.bulk_modulus_pa)),
            bulk_modulus_pa: factor * self.bulk_modulus_pa,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thin_wall_follows_korteweg() {
        let thin = wall_bulk_modulus_pa(0.015, 1e-6, 1e9, 0.4);
        assert!((thin / (1e9 * 1e-6 / 0.015) - 1.0).abs() < 1e-3, "{thin}");
        // A bore in an infinite block: E/(2(1 + ν)), the shear modulus.
        let thick = wall_bulk_modulus_pa(0.015, 1e3, 1e9, 0.4);
        assert!((thick / (1e9 / 2.8) - 1.0).abs() < 1e-6, "{thick}");
    }

    #[test]
    fn as_printed_only_the_fluid_is_compliant() {
        let printed = Parameters::printed();
        let double = 2.0 * printed.line_stiffness_n_per_m();
        for half in printed.half_line_stiffness_n_per_m() {
            assert!((half / double - 1.0).abs() < 1e-14, "{half} {double}");
        }
    }

    /// The figures of `docs/errata.md`.
    #[test]
    fn single_causes_of_the_traced_softness() {
        let by = Parameters::printed().explain_softening(1.0 / 14.0);
        for (found, told) in [
            (by.wall_modulus_pa, 1.35e9),
            (by.gas_fraction, 7.1e-4),
            (by.belt_stiffness_n_per_m, 17e3),
            (by.bulk_modulus_pa, 1.33e8),
        ] {
            assert!((found / told - 1.0).abs() < 0.01, "{found} {told}");
        }
    }

    /// Each explanation, put back as a parameter, gives the softened line again.
    #[test]
    fn each_explanation_softens_as_asked() {
        let printed = Parameters::printed();
        for factor in [0.5, 1.0 / 14.0, 0.01] {
            let by = printed.explain_softening(factor);
            let wanted = 2.0 * printed.line_stiffness_n_per_m() * factor;
            let wall = Parameters { hose_wall_modulus_pa: by.wall_modulus_pa, ..printed.clone() };
            let gas = Parameters { gas_fraction: by.gas_fraction, ..printed.clone() };
            let fluid = Parameters { bulk_modulus_pa: by.bulk_modulus_pa, ..printed.clone() };
            for softened in [wall, gas, fluid] {
                for half in softened.half_line_stiffness_n_per_m() {
                    assert!(
                        (half / wanted - 1.0).abs() < 1e-9,
                        "{factor}: {half} {wanted} {softened:?}"
                    );
                }
            }
            let belts =
                Parameters { belt_stiffness_n_per_m: by.belt_stiffness_n_per_m, ..printed.clone() };
            let [master, slave] = belts.half_line_stiffness_n_per_m();
            assert!(
                (0.5 * (master + slave) / wanted - 1.0).abs() < 0.01,
                "{factor}: {master} {slave} {wanted}"
            );
        }
        assert!(
            printed.explain_softening(1.5).wall_modulus_pa.is_nan(),
            "a stiffer line is not softened"
        );
    }
}

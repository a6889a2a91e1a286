//! Loss of head in a full pipe: Darcy-Weisbach (eq. 3.1.10, 3.1.11).

/// End of laminar flow, `Re` (§ 3.1.1).
pub const LAMINAR_END: f64 = 2000.0;
/// Start of fully turbulent flow, `Re`; the factor is interpolated linearly between the two.
pub const TURBULENT_START: f64 = 4000.0;

/// Darcy's friction factor `f`.
///
/// Laminar `64/Re` (§ 3.1.1); turbulent after Haaland (J. Fluids Eng. 105, 1983), an explicit form
/// of Colebrook's equation, which § 3.1.1 calls "simplified" without naming it: `1/√f = -1.8
/// log10((ε/3.7)^1.11 + 6.9/Re)`. Between `Re` 2000 and 4000 the two ends are joined linearly, so
/// that the force is continuous and grows with speed. `relative_roughness` is wall roughness over
/// diameter.
pub fn friction_factor(reynolds: f64, relative_roughness: f64) -> f64 {
    let haaland = |reynolds: f64| {
        let root = -1.8 * ((relative_roughness / 3.7).powf(1.11) + 6.9 / reynolds).log10();
        1.0 / (root * root)
    };
    if reynolds <= LAMINAR_END {
        64.0 / reynolds
    } else if reynolds < TURBULENT_START {
        let part = (reynolds - LAMINAR_END) / (TURBULENT_START - LAMINAR_END);
        64.0 / LAMINAR_END * (1.0 - part) + haaland(TURBULENT_START) * part
    } else {
        haaland(reynolds)
    }
}

/// A pipe's loss as a force on its fluid, against the movement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pipe {
    laminar: f64,
    reynolds_per_speed: f64,
    turbulent: f64,
    relative_roughness: f64,
}

impl Pipe {
    /// A pipe of `length_m`, `diameter_m`, `area_m2` and wall roughness `roughness_m`, full of a
    /// fluid of `viscosity_pa_s` (dynamic) and `density_kg_m3`.
    ///
    /// Area and diameter are separate because the printed values contradict each other
    /// (`docs/errata.md`).
    pub fn new(
        length_m: f64,
        diameter_m: f64,
        area_m2: f64,
        roughness_m: f64,
        viscosity_pa_s: f64,
        density_kg_m3: f64,
    ) -> Self {
        Self {
            laminar: 32.0 * viscosity_pa_s * length_m * area_m2 / (diameter_m * diameter_m),
            reynolds_per_speed: density_kg_m3 * diameter_m / viscosity_pa_s,
            turbulent: density_kg_m3 * area_m2 * length_m / (2.0 * diameter_m),
            relative_roughness: roughness_m / diameter_m,
        }
    }

    /// Force over speed, N·s/m, at a speed in m/s: `F_lf / v = f L |v| ρ A / (2 d)`, which is `32 ν
    /// L A / d²` while the flow is laminar.
    #[inline]
    pub fn coefficient(&self, speed_m_s: f64) -> f64 {
        let reynolds = self.reynolds_per_speed * speed_m_s.abs();
        if reynolds <= LAMINAR_END {
            return self.laminar;
        }
        self.beyond_laminar(reynolds, speed_m_s.abs())
    }

    /// Out of line: otherwise the optimiser computes powers and logarithms speculatively in every
    /// step.
    #[cold]
    #[inline(never)]
    fn beyond_laminar(&self, reynolds: f64, speed_m_s: f64) -> f64 {
        friction_factor(reynolds, self.relative_roughness) * self.turbulent * speed_m_s
    }

    /// Reynolds number at a speed in m/s.
    pub fn reynolds(&self, speed_m_s: f64) -> f64 {
        self.reynolds_per_speed * speed_m_s.abs()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factor_is_continuous_and_known() {
        for reynolds in [LAMINAR_END, TURBULENT_START] {
            let (below, above) = (
                friction_factor(reynolds * (1.0 - 1e-9), 0.0),
                friction_factor(reynolds * (1.0 + 1e-9), 0.0),
            );
            assert!((below - above).abs() < 1e-8, "{reynolds}: {below} {above}");
        }
        // Colebrook, smooth, Re = 1e5: f = 0.01799; Haaland is within 2 %.
        assert!((friction_factor(1e5, 0.0) / 0.01799 - 1.0).abs() < 0.02);
        // Moody chart, ε/d = 0.01, Re = 1e6: 0.0379.
        assert!((friction_factor(1e6, 0.01) / 0.0379 - 1.0).abs() < 0.02);
    }

    #[test]
    fn force_grows_with_speed() {
        let pipe = Pipe::new(10.0, 0.009, 1.760e-4, 0.0, 8.470e-3, 847.0);
        let mut last = 0.0;
        for i in 1..1000 {
            let speed = f64::from(i) * 0.02;
            let force = pipe.coefficient(speed) * speed;
            assert!(force > last, "at {speed} m/s, Re {}", pipe.reynolds(speed));
            last = force;
        }
    }
}

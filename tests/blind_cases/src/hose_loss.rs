//! Loss of the fluid in a hose, from laminar to turbulent flow.

use crate::machine_parameters::MachineParameters;

/// Loss over the fluid's speed in one hose: eq. 3.1.10 and 3.1.11 with `64/Re` below Re 2000,
/// Haaland's form of Colebrook's equation above 4000, and a straight line between.
#[derive(Clone, Debug)]
pub struct HoseLoss {
    density_kg_m3: f64,
    viscosity_pa_s: f64,
    diameter_m: f64,
    volume_m3: f64,
    laminar_n_s_per_m: f64,
    /// The term of the wall's roughness in Haaland's form.
    roughness: f64,
    /// Friction factor at Re 4000.
    turbulent: f64,
}

impl HoseLoss {
    /// Of one hose of a machine.
    pub fn of(machine: &MachineParameters) -> Self {
        let (diameter_m, viscosity_pa_s) = (machine.hose_diameter_m, machine.fluid_viscosity_pa_s);
        let volume_m3 = machine.hose_area_m2 * machine.hose_length_m;
        let roughness = (machine.hose_roughness_m / diameter_m / 3.7).powf(1.11);
        Self {
            density_kg_m3: machine.fluid_density_kg_m3,
            viscosity_pa_s,
            diameter_m,
            volume_m3,
            laminar_n_s_per_m: 32.0 * viscosity_pa_s * volume_m3 / diameter_m.powi(2),
            roughness,
            turbulent: haaland(roughness, 4000.0),
        }
    }

    /// Loss over the speed at a speed (m/s), N·s/m.
    pub fn n_s_per_m(&self, speed_m_s: f64) -> f64 {
        let speed = speed_m_s.abs();
        let reynolds = self.density_kg_m3 * speed * self.diameter_m / self.viscosity_pa_s;
        if reynolds <= 2000.0 {
            return self.laminar_n_s_per_m;
        }
        let factor = if reynolds < 4000.0 {
            let part = (reynolds - 2000.0) / 2000.0;
            (1.0 - part) * 0.032 + part * self.turbulent
        } else {
            haaland(self.roughness, reynolds)
        };
        factor * self.density_kg_m3 * self.volume_m3 * speed / (2.0 * self.diameter_m)
    }
}

fn haaland(roughness: f64, reynolds: f64) -> f64 {
    (-1.8 * (roughness + 6.9 / reynolds).log10()).powi(-2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loss_is_continuous() {
        let machine = MachineParameters::declared();
        let loss = HoseLoss::of(&machine);
        let speed_of = |reynolds: f64| reynolds * machine.fluid_viscosity_pa_s / 847.0 / 0.009;
        for reynolds in [2000.0, 4000.0] {
            let below = loss.n_s_per_m(speed_of(reynolds * (1.0 - 1e-9)));
            let above = loss.n_s_per_m(speed_of(reynolds * (1.0 + 1e-9)));
            assert!((above / below - 1.0).abs() < 1e-6, "{reynolds}: {below} {above}");
        }
        // 32 ν L A / d² with the numbers of § 3.2.1.
        assert!((loss.n_s_per_m(0.1) - 5.889).abs() < 1e-3);
    }
}

//! The effect that the demo hides in the simulated machine.

use plant::effects::Site;
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;

/// An effect that may be drawn, with the range of its size in its own unit.
#[derive(Clone, Copy, Debug)]
struct Drawn {
    id: &'static str,
    site: Site,
    sizes: (f64, f64),
}

/// All that may be drawn. The sizes are such that the effect changes how the handle follows, and is
/// beyond the tolerances of the declared parameters.
const DRAWN: &[Drawn] = &[
    Drawn { id: "backlash", site: Site::Slave, sizes: (0.03, 0.08) },
    Drawn { id: "coulomb_friction", site: Site::Master, sizes: (0.35, 0.6) },
    Drawn { id: "viscous_friction", site: Site::Slave, sizes: (0.1, 0.2) },
    Drawn { id: "gravity_imbalance", site: Site::Slave, sizes: (0.7, 1.5) },
    Drawn { id: "line_compliance", site: Site::Line, sizes: (0.7, 1.2) },
    Drawn { id: "leakage", site: Site::Line, sizes: (1.5e-12, 3.5e-12) },
    Drawn { id: "torque_ripple", site: Site::Drive, sizes: (0.15, 0.4) },
    Drawn { id: "extra_inertia", site: Site::Slave, sizes: (2e-3, 5e-3) },
];

/// Draws an effect, as `ID@SITE=SIZE`; sizes are uniform in their logarithm.
pub fn draw(seed: u64) -> String {
    let mut generator = Pcg64Mcg::seed_from_u64(seed);
    let Drawn { id, site, sizes: (low, high) } = DRAWN[generator.random_range(0..DRAWN.len())];
    let size = low * (high / low).powf(generator.random_range(0.0..1.0));
    format!("{id}@{}={size:.3e}", site.name())
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn every_effect_is_drawn_and_can_be_made() {
        let drawn: Vec<String> = (0..200).map(draw).collect();
        for text in &drawn {
            plant::effects::parse(text).unwrap();
        }
        let names: BTreeSet<&str> =
            drawn.iter().filter_map(|text| text.split_once('=')).map(|(name, _)| name).collect();
        assert_eq!(names.len(), DRAWN.len(), "{names:?}");
        assert_eq!(draw(7), draw(7), "the same seed, the same effect");
    }
}

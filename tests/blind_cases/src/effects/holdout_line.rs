//! Hold-out effects at the line.

use super::{Entry, Site, Values, Variable};
use crate::deviation::{Deviation, Link, View};

pub(super) const ENTRIES: &[Entry] = &[
    Entry {
        id: "hose_kink",
        site: Site::Line,
        depends_on: &[Variable::Position, Variable::Velocity],
        draw: |draw, _| {
            Values::of([
                ("loss", draw.uniform(60.0, 140.0), "N s/m"),
                ("angle", draw.sign() * draw.uniform(0.1, 0.35), "rad"),
            ])
        },
        build: |values, _| Box::new(Kink { loss: values.get("loss"), angle: values.get("angle") }),
    },
    Entry {
        id: "diaphragm_inversion",
        site: Site::Line,
        depends_on: &[Variable::Load],
        draw: |draw, _| {
            Values::of([
                ("displacement", draw.uniform(4e-4, 9e-4), "m"),
                ("force", draw.uniform(5.0, 10.0), "N"),
            ])
        },
        build: |values, _| {
            Box::new(Inversion {
                displacement: values.get("displacement"),
                force: values.get("force"),
            })
        },
    },
    Entry {
        id: "stiffness_over_stroke",
        site: Site::Line,
        depends_on: &[Variable::Position, Variable::Load],
        draw: |draw, _| {
            Values::of([
                ("ratio", draw.uniform(3.0, 6.0), "1"),
                ("middle", draw.uniform(-0.015, 0.015), "m"),
                ("direction", draw.sign(), "1"),
            ])
        },
        build: |values, _| {
            Box::new(Bulge {
                ratio: values.get("ratio"),
                middle: values.get("middle"),
                direction: values.get("direction"),
            })
        },
    },
];

/// Angle over which a hose folds, rad.
const FOLD_RAD: f64 = 0.1;

/// Hoses that the handle kinks beyond an angle: both then have an additional loss, `c v` when fully
/// folded.
#[derive(Debug)]
struct Kink {
    loss: f64,
    angle: f64,
}

impl Deviation for Kink {
    fn hose_loss(&self, _line: usize, loss: f64, view: &View<'_>) -> f64 {
        let beyond =
            ((view.position[1] - self.angle) * self.angle.signum() / FOLD_RAD).clamp(0.0, 1.0);
        loss + self.loss * beyond * beyond * (3.0 - 2.0 * beyond)
    }
}

/// Time constant of the inversion, s.
const TURN_S: f64 = 2e-3;
/// Local maximum of `z - z³`.
const CREST: f64 = 0.384_900_179_459_750_5;

/// Rolling diaphragms whose convolution inverts when the pressure reverses far enough, with some
/// displacement: `T ż = z - z³ + c f/f₀`, which has two equilibria below `f₀`. States: position of
/// each of the four, -1 to 1.
#[derive(Debug)]
struct Inversion {
    displacement: f64,
    force: f64,
}

impl Deviation for Inversion {
    fn states(&self) -> usize {
        4
    }

    fn stretch(&self, link: &mut Link, _view: &View<'_>, own: &[f64]) {
        link.deflection_m -= self.displacement * own[2 * link.line + link.side];
    }

    fn link(&self, link: &mut Link, _view: &View<'_>, own: &[f64], rates: &mut [f64]) {
        let index = 2 * link.line + link.side;
        let lies = own[index];
        rates[index] = (lies - lies.powi(3) + CREST * link.force_n / self.force) / TURN_S;
    }
}

/// Stroke over which the wall becomes free, m.
const WALL_M: f64 = 0.02;

/// A diaphragm of the first line whose wall bulges where it is free: the line is softer on one half
/// of the stroke than on the other, `K(x) = K/(1 + r u)` with `u` from 0 to 1 along the
/// displacement of the fluid.
#[derive(Debug)]
struct Bulge {
    ratio: f64,
    middle: f64,
    direction: f64,
}

impl Bulge {
    /// Stiffness over the declared one at a place (m), and its slope (1/m).
    fn share(&self, place_m: f64) -> [f64; 2] {
        let bent = (self.direction * (place_m - self.middle) / WALL_M).tanh();
        let share = 1.0 / (1.0 + self.ratio * 0.5 * (1.0 + bent));
        [share, -share * share * self.ratio * 0.5 * (1.0 - bent * bent) * self.direction / WALL_M]
    }
}

impl Deviation for Bulge {
    fn link(&self, link: &mut Link, _view: &View<'_>, _own: &[f64], _rates: &mut [f64]) {
        if link.line == 0 {
            let [share, slope] = self.share(link.fluid_position_m);
            let less = (share - 1.0) * link.stiffness_n_per_m * link.deflection_m;
            link.force_n += less;
            // The wall pushes the fluid toward the softer side, since the stored energy also
            // depends on the displacement of the fluid.
            link.fluid_force_n +=
                less + 0.5 * slope * link.stiffness_n_per_m * link.deflection_m.powi(2);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine_parameters::MachineParameters;
    use crate::simulator::{Input, Simulator, State};
    use crate::smoothing::{Shape, Smoothing};

    fn link(force_n: f64) -> Link {
        Link {
            side: 0,
            line: 0,
            stiffness_n_per_m: 1.0,
            damping_n_s_per_m: 0.0,
            displacement_m_per_rad: 1.0,
            deflection_m: 0.0,
            rate_m_s: 0.0,
            fluid_position_m: 0.0,
            force_n,
            fluid_force_n: force_n,
        }
    }

    #[test]
    fn a_kink_adds_loss_beyond_its_angle_only() {
        for angle in [0.2, -0.2] {
            let kink = Kink { loss: 100.0, angle };
            let at = |slave: f64| {
                kink.hose_loss(1, 6.0, &View { position: [0.0, slave], ..View::at_rest() })
            };
            assert_eq!([at(-angle), at(0.0), at(angle)], [6.0; 3]);
            assert!(
                (at(1.25 * angle) - 56.0).abs() < 1e-9 && (at(2.0 * angle) - 106.0).abs() < 1e-9
            );
        }
    }

    /// Turns at plus and minus its force, late in both directions, and takes energy on the way
    /// round.
    #[test]
    fn a_diaphragm_inverts_with_hysteresis_and_dissipates() {
        let inversion = Inversion { displacement: 1e-3, force: 8.0 };
        let mut own = [0.0; 4];
        let (mut work, mut turned) = (0.0, Vec::new());
        // Two slow rounds between ±16 N; the second is the one that counts.
        for index in 0..800_000 {
            let phase = f64::from(index) / 400_000.0;
            let force = 16.0 * (std::f64::consts::TAU * phase).sin();
            let mut rates = [0.0; 4];
            inversion.link(&mut link(force), &View::at_rest(), &own, &mut rates);
            let before = own[0];
            own[0] += 1e-5 * rates[0];
            if phase > 1.0 {
                work += force * inversion.displacement * (own[0] - before);
                if before.signum() != own[0].signum() {
                    turned.push(force);
                }
            }
        }
        turned.sort_by(f64::total_cmp);
        assert_eq!(turned.len(), 2, "{turned:?}");
        assert!((turned[0] + 8.0).abs() < 1.0 && (turned[1] - 8.0).abs() < 1.0, "{turned:?} N");
        assert!(work > 0.02, "{work} J");
    }

    /// With the energy of its softened springs, the machine only loses.
    #[test]
    fn a_bulging_wall_is_passive() {
        let make = || Bulge { ratio: 4.0, middle: 0.005, direction: -1.0 };
        let smoothing = Smoothing { shape: Shape::Root, speed_rad_s: 0.1 };
        let model = Simulator::new(
            MachineParameters::declared(),
            smoothing,
            vec![Box::new(make())],
            0.5e-3,
        )
        .unwrap();
        let half_line = 2.0 * model.machine().line_stiffness_n_per_m();
        let ratios = model.machine().displacement_m_per_rad();
        let energy = |state: &State| {
            let x = &state.0;
            let [share, _] = make().share(x[4]);
            let springs: f64 = [0, 1]
                .map(|side| 0.5 * half_line * (x[4] - ratios[side] * x[2 * side]).powi(2))
                .iter()
                .sum();
            model.energy_j(state) + (share - 1.0) * springs
        };
        let mut state = State::default();
        (state.0[1], state.0[3]) = (9.0, 7.0);
        let (first, mut last) = (energy(&state), f64::INFINITY);
        for index in 0..2000 {
            let now = energy(&state);
            assert!(now <= last * (1.0 + 1e-6) + 1e-9, "row {index}: {last} to {now} J");
            last = now;
            let time = f64::from(index) * 0.5e-3;
            model.advance(&mut state, time, time, &Input { volts: &[0.0], ..Input::default() });
        }
        assert!(last < 0.5 * first, "{first} to {last} J");
    }
}

//! Hold-out effects at master and slave.

use super::{Entry, Site, Values, Variable};
use crate::deviation::{Deviation, Link, Side, View};

pub(super) const ENTRIES: &[Entry] = &[
    Entry {
        id: "tooth_jump",
        site: Site::Master,
        depends_on: &[Variable::Load],
        draw: |draw, _| {
            // A pitch of 2 mm on a pulley of 31 mm.
            Values::of([("torque", draw.uniform(2.3, 2.8), "N m"), ("pitch", 2.0 / 31.0, "rad")])
        },
        build: |values, _| {
            Box::new(ToothJump { torque: values.get("torque"), pitch: values.get("pitch") })
        },
    },
    Entry {
        id: "lip_rollover",
        site: Site::Slave,
        depends_on: &[Variable::Position, Variable::Velocity],
        draw: |draw, _| {
            Values::of([
                ("level", draw.uniform(0.5, 1.0), "N m"),
                ("travel", draw.uniform(0.08, 0.25), "rad"),
            ])
        },
        build: |values, _| {
            Box::new(Lip { level: values.get("level"), travel: values.get("travel") })
        },
    },
    Entry {
        id: "thixotropic_grease",
        site: Site::Master,
        depends_on: &[Variable::Velocity, Variable::Time],
        draw: |draw, _| {
            Values::of([
                ("coefficient", draw.uniform(0.3, 0.7), "N m s/rad"),
                ("travel", draw.uniform(0.3, 0.8), "rad"),
                ("rebuild_s", draw.log_uniform(0.3, 1.0), "s"),
            ])
        },
        build: |values, _| {
            Box::new(Grease {
                coefficient: values.get("coefficient"),
                travel: values.get("travel"),
                rebuild_s: values.get("rebuild_s"),
            })
        },
    },
    Entry {
        id: "crank_weight",
        site: Site::Slave,
        depends_on: &[Variable::Acceleration, Variable::Position],
        draw: |draw, _| {
            Values::of([
                ("inertia", draw.uniform(5e-3, 9e-3), "kg m^2"),
                ("angle", draw.uniform(-0.4, 0.4), "rad"),
            ])
        },
        build: |values, _| {
            Box::new(Crank { inertia: values.get("inertia"), angle: values.get("angle") })
        },
    },
];

/// Speed with which a belt climbs a tooth, rad/s per N·m of unbalanced torque.
const CLIMB_RAD_S_PER_NM: f64 = 20.0;
/// Softness of the holding torque about the middle of a tooth: the square of the part of a pitch,
/// in radians, over which it builds up.
const TOOTH_SOFTNESS: f64 = 0.04;

/// A slack toothed belt: each of the two holds half of a torque; beyond it, it skips to another
/// tooth and stays there. States: displacement of each on its pulley, rad.
#[derive(Debug)]
struct ToothJump {
    torque: f64,
    pitch: f64,
}

impl ToothJump {
    /// Holding torque of a tooth, N·m, over the displacement of the belt (rad): zero in the middle
    /// of a tooth and on its crest.
    fn hold(&self, moved: f64) -> f64 {
        let sine = (std::f64::consts::TAU * moved / self.pitch).sin();
        0.5 * self.torque * sine * ((1.0 + TOOTH_SOFTNESS) / (sine * sine + TOOTH_SOFTNESS)).sqrt()
    }

    fn climb(&self, moved: f64, torque: f64) -> f64 {
        -CLIMB_RAD_S_PER_NM * (torque + self.hold(moved))
    }
}

impl Deviation for ToothJump {
    fn states(&self) -> usize {
        2
    }

    fn stretch(&self, link: &mut Link, _view: &View<'_>, own: &[f64]) {
        if link.side == 0 {
            link.deflection_m += link.displacement_m_per_rad * own[link.line];
        }
    }

    fn link(&self, link: &mut Link, _view: &View<'_>, own: &[f64], rates: &mut [f64]) {
        if link.side == 0 {
            rates[link.line] =
                self.climb(own[link.line], link.displacement_m_per_rad * link.force_n);
        }
    }
}

/// A seal whose lip leans with the direction of travel: after a reversal it has to flip, with an
/// additional torque until it leans the other way. The state is its position, -1 to 1.
#[derive(Debug)]
struct Lip {
    level: f64,
    travel: f64,
}

impl Deviation for Lip {
    fn states(&self) -> usize {
        1
    }

    fn side(&self, side: &mut Side, _view: &View<'_>, own: &[f64], rates: &mut [f64]) {
        if side.side == 1 {
            rates[0] = (side.velocity_rad_s - side.velocity_rad_s.abs() * own[0]) / self.travel;
            let lies = own[0].clamp(-1.0, 1.0);
            side.dry_forward += 0.5 * self.level * (1.0 - lies);
            side.dry_backward += 0.5 * self.level * (1.0 + lies);
        }
    }
}

/// Thixotropic grease: drag `c (1 - b) q̇`, where `b` is the part of its structure that movement
/// has broken and that recovers at rest.
#[derive(Debug)]
struct Grease {
    coefficient: f64,
    travel: f64,
    rebuild_s: f64,
}

impl Deviation for Grease {
    fn states(&self) -> usize {
        1
    }

    fn side(&self, side: &mut Side, _view: &View<'_>, own: &[f64], rates: &mut [f64]) {
        if side.side == 0 {
            rates[0] =
                side.velocity_rad_s.abs() / self.travel * (1.0 - own[0]) - own[0] / self.rebuild_s;
            side.add_viscous(self.coefficient * (1.0 - own[0].clamp(0.0, 1.0)));
        }
    }
}

/// Natural frequency of the rod that carries the weight, rad/s: far above the movements of a hand.
const ROD_RAD_S: f64 = 180.0;
/// Damping ratio of the rod.
const ROD_DAMPING: f64 = 0.3;

/// A counterweight that the handle moves by a crank: `y = l cos(q - q₀)`, an inertia
/// `J sin²(q - q₀)` that varies along the stroke. States: displacement and speed of the weight over
/// the length of the crank, relative to angle zero.
#[derive(Debug)]
struct Crank {
    inertia: f64,
    angle: f64,
}

impl Crank {
    /// Stretch of the rod and its rate, over the length of the crank; and the effective length at
    /// this angle.
    fn rod(&self, position: f64, velocity: f64, own: &[f64]) -> [f64; 3] {
        let lever = (position - self.angle).sin();
        let stretch = self.angle.cos() - (position - self.angle).cos() - own[0];
        [stretch, lever * velocity - own[1], lever]
    }
}

impl Deviation for Crank {
    fn states(&self) -> usize {
        2
    }

    fn side(&self, side: &mut Side, _view: &View<'_>, own: &[f64], rates: &mut [f64]) {
        if side.side == 1 {
            let [stretch, rate, lever] = self.rod(side.position_rad, side.velocity_rad_s, own);
            let acceleration = ROD_RAD_S * (ROD_RAD_S * stretch + 2.0 * ROD_DAMPING * rate);
            (rates[0], rates[1]) = (own[1], acceleration);
            side.torque_nm -= self.inertia * acceleration * lever;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine_parameters::MachineParameters;
    use crate::simulator::{Input, Simulator, State};
    use crate::smoothing::{Shape, Smoothing};

    const SMOOTHING: Smoothing = Smoothing { shape: Shape::Root, speed_rad_s: 0.1 };

    /// Energy of the model at every sample of a run that begins with both sides moving, with what
    /// an effect stores added.
    fn energies(deviation: Box<dyn Deviation>, stored: impl Fn(&State) -> f64) -> Vec<f64> {
        let model =
            Simulator::new(MachineParameters::declared(), SMOOTHING, vec![deviation], 0.5e-3)
                .unwrap();
        let mut state = State::default();
        (state.0[1], state.0[3]) = (8.0, -6.0);
        (0..2000)
            .map(|index| {
                let energy = model.energy_j(&state) + stored(&state);
                let time = f64::from(index) * 0.5e-3;
                model.advance(&mut state, time, time, &Input { volts: &[0.0], ..Input::default() });
                energy
            })
            .collect()
    }

    fn only_falls(energies: &[f64]) {
        for (index, two) in energies.windows(2).enumerate() {
            assert!(
                two[1] <= two[0] * (1.0 + 1e-6) + 1e-9,
                "row {index}: {} to {} J",
                two[0],
                two[1]
            );
        }
        assert!(energies[energies.len() - 1] < 0.5 * energies[0]);
    }

    #[test]
    fn lips_and_grease_dissipate() {
        only_falls(&energies(Box::new(Lip { level: 0.8, travel: 0.15 }), |_| 0.0));
        only_falls(&energies(
            Box::new(Grease { coefficient: 0.5, travel: 0.5, rebuild_s: 0.5 }),
            |_| 0.0,
        ));
    }

    #[test]
    fn a_crank_stores_energy_and_is_passive() {
        let (inertia, angle) = (7e-3, 0.3);
        let stored = |state: &State| {
            let stretch = Crank { inertia, angle }.rod(state.0[2], state.0[3], &state.0[8..10])[0];
            0.5 * inertia * (state.0[9].powi(2) + (ROD_RAD_S * stretch).powi(2))
        };
        only_falls(&energies(Box::new(Crank { inertia, angle }), stored));
    }

    /// More friction after a reversal than a way later, in either direction.
    #[test]
    fn a_lip_resists_after_a_reversal() {
        let lip = Lip { level: 0.8, travel: 0.1 };
        let mut lies = [0.0];
        let mut push = |speed: f64, way: f64| {
            let mut levels = Vec::new();
            for _ in 0..1000 {
                let mut side = resting(1);
                side.velocity_rad_s = speed;
                let mut rates = [0.0];
                lip.side(&mut side, &View::at_rest(), &lies, &mut rates);
                lies[0] += rates[0] * way / speed.abs() / 1000.0;
                levels.push(if speed > 0.0 { side.dry_forward } else { side.dry_backward });
            }
            [levels[0], levels[999]]
        };
        push(1.0, 1.0);
        for speed in [-2.0, 0.5, -1.0] {
            let [first, last] = push(speed, 1.0);
            assert!((first - 0.8).abs() < 1e-3 && last.abs() < 1e-3, "{first} {last}");
        }
    }

    fn resting(side: usize) -> Side {
        Side {
            side,
            position_rad: 0.0,
            velocity_rad_s: 0.0,
            smoothing: SMOOTHING,
            transmitted_nm: 0.0,
            torque_nm: 0.0,
            dry_forward: 0.0,
            dry_backward: 0.0,
            dry_at_rest_nm: 0.0,
            viscous_forward: 0.0,
            viscous_backward: 0.0,
        }
    }

    #[test]
    fn a_belt_holds_and_then_skips_whole_teeth() {
        let belt = ToothJump { torque: 2.0, pitch: 0.1 };
        let mut moved = 0.0;
        let mut pull = |torque: f64, seconds: f64| {
            for _ in 0..(seconds / 1e-5) as usize {
                moved += 1e-5 * belt.climb(moved, torque);
            }
            moved / 0.1
        };
        let held = pull(0.95, 0.1);
        assert!((-0.25..0.0).contains(&held), "{held} teeth");
        assert!(pull(0.0, 0.1).abs() < 1e-3, "back in its tooth");
        let jumped = pull(1.5, 0.02);
        assert!(jumped < -1.0, "{jumped} teeth, with the torque");
        let stays = pull(0.0, 0.1);
        assert!((stays - stays.round()).abs() < 1e-3 && stays.round() <= -1.0, "{stays} teeth");
    }
}

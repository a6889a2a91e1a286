//! The force field of a free movement, as a protocol gives it.

use crate::axis::AxisUnit;
use crate::read::{Bounds, Section, bounds};

/// What the hand feels of one axis while it moves freely; all zero: nothing but what the control leaves of the machine.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Field {
    /// Stiffness about the centre; negative drives away from it (N·m/rad or N/m).
    pub stiffness: f64,
    /// Damping; negative feeds a movement (N·m·s/rad or N·s/m).
    pub damping: f64,
    /// Centre of the spring (rad or m).
    pub centre: f64,
    /// Where walls begin: below and above (rad or m).
    pub walls: Option<(f64, f64)>,
    /// Stiffness of the walls (N·m/rad or N/m).
    pub wall_stiffness: f64,
}

/// Springs and dampers for which the twin of the shipped rig was seen to stay at rest with a relaxed hand.
const SPRING: Bounds = bounds(-5.0, 10.0, "N·m/rad, or N/m on an axis in m; the thesis's screen has 0.1 to 2");
const DAMPER: Bounds = bounds(-0.5, 2.0, "N·m·s/rad, or N·s/m on an axis in m");
const WALL: Bounds = bounds(0.1, 50.0, "N·m/rad, or N/m on an axis in m");

impl Field {
    /// Stiffnesses and damping; `centre` and `walls` in rad or m.
    pub(super) fn read(section: &Section<'_>, centre: f64, walls: [Option<f64>; 2]) -> Self {
        let walls = match walls {
            [Some(least), Some(most)] if least < most => Some((least, most)),
            [None, None] => None,
            [Some(_), Some(_)] => {
                section.problem("wall_max_deg", "more than wall_min_deg", "walls the wrong way round", "swap the two");
                None
            }
            _ => {
                section.problem(
                    "wall_min_deg",
                    "both walls",
                    "one",
                    "give wall_min and wall_max; one may lie at the limit",
                );
                None
            }
        };
        let wall_stiffness = match walls {
            Some(_) => section.number_or("wall_stiffness", 10.0, WALL),
            None => {
                if section.has("wall_stiffness") {
                    section.problem(
                        "wall_stiffness",
                        "walls",
                        "their stiffness alone",
                        "add wall_min_deg and wall_max_deg",
                    );
                    section.number_or_none("wall_stiffness", WALL);
                }
                0.0
            }
        };
        Self {
            stiffness: section.number_or("spring", 0.0, SPRING),
            damping: section.number_or("damper", 0.0, DAMPER),
            centre,
            walls,
            wall_stiffness,
        }
    }

    /// Torque of spring and walls on an axis at rest there (N·m or N).
    pub fn torque(&self, position: f64) -> f64 {
        let spring = -self.stiffness * (position - self.centre);
        let wall = self.walls.map_or(0.0, |(least, most)| position.max(least).min(most) - position);
        spring + self.wall_stiffness * wall
    }

    /// Its largest torque at rest within limits (N·m or N), and where (rad or m).
    pub fn largest_torque(&self, least: f64, most: f64) -> (f64, f64) {
        // Linear between the walls' edges and the limits: the largest stands at one of them.
        let edges = self.walls.map_or([least, most], |(low, high)| [low, high]);
        [least, most]
            .into_iter()
            .chain(edges)
            .filter(|at| (least..=most).contains(at))
            .map(|at| (self.torque(at), at))
            .max_by(|a, b| a.0.abs().total_cmp(&b.0.abs()))
            .unwrap_or((0.0, least))
    }
}

/// The symbol of a torque on an axis of that unit.
pub(super) const fn torque_symbol(unit: AxisUnit) -> &'static str {
    match unit {
        AxisUnit::Radian => "N·m",
        AxisUnit::Metre => "N",
    }
}

//! The force field in which the hand moves.

use super::matrix::Matrix;
use super::torque_table::TorqueTable;
use crate::axis_unit::AxisUnit;
use crate::checked_toml::{Bounds, Keys, Section, bounds};

/// The force field of one axis in free movement; all zero: the hand feels only what force control
/// leaves of the machine.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Field {
    /// Stiffness about the centre; negative drives away from it (N·m/rad or N/m).
    pub stiffness: f64,
    /// Damping; negative feeds a movement (N·m·s/rad or N·s/m).
    pub damping: f64,
    /// Inertia; negative reduces the machine's apparent inertia (kg·m² or kg).
    pub inertia: f64,
    /// Torque over position (N·m or N over rad or m).
    pub position_table: Option<Box<TorqueTable>>,
    /// Torque over velocity (N·m or N over rad/s or m/s).
    pub velocity_table: Option<Box<TorqueTable>>,
    /// Matrices over several axes, added to the rest.
    pub matrix: Option<Box<Matrix>>,
    /// Centre of the spring (rad or m).
    pub centre: f64,
    /// Where walls begin: below and above (rad or m).
    pub walls: Option<(f64, f64)>,
    /// Stiffness of the walls (N·m/rad or N/m).
    pub wall_stiffness: f64,
}

pub(super) const SPRING_ADVICE: &str =
    "N·m/rad, or N/m on an axis in m; the thesis's screen has 0.1 to 2";
// Bounds for any rig; stability is checked against the rig.
const SPRING: Bounds = bounds(-5.0, 10.0, SPRING_ADVICE);
pub(super) const DAMPER: Bounds = bounds(-0.5, 2.0, "N·m·s/rad, or N·s/m on an axis in m");
const INERTIA: Bounds =
    bounds(-0.1, 0.1, "kg·m², or kg on an axis in m; the handle's own is 0.002");
const WALL: Bounds = bounds(0.1, 50.0, "N·m/rad, or N/m on an axis in m");

/// The keys of a field.
pub(super) const FIELD_KEYS: Keys = &[
    ("duration_s", "Duration."),
    ("spring", "Stiffness about the centre, in N·m/rad or N/m; negative drives away from it."),
    ("damper", "Damping, in N·m·s/rad or N·s/m; negative feeds energy into a movement."),
    ("inertia", "Inertia, in kg·m² or kg; negative reduces the machine's apparent inertia."),
    ("centre_{deg,m}", "Centre of the spring; 0, if left out."),
    ("wall_min_{deg,m}", "Position of the lower wall; both walls or none."),
    ("wall_max_{deg,m}", "Position of the upper wall."),
    ("wall_stiffness", "Stiffness of the walls, in N·m/rad or N/m."),
    ("position_table_{deg,m}", "Torque over position: pairs [position, torque in N·m or N]."),
    ("velocity_table_{deg,m}_s", "Torque over velocity: pairs [velocity, torque in N·m or N]."),
    ("matrix_stiffness", "Stiffness matrix over the axes, a row per axis: torque = -K (x - x₀)."),
    ("matrix_damping", "Damping matrix over the axes: torque = -D v."),
    ("matrix_inertia", "Inertia matrix over the axes: torque = -M a."),
    ("curl", "Curl field over the first two axes, in N·m·s/rad or N·s/m."),
    ("centres_{deg,m}", "Centre of the stiffness matrix, a number per axis."),
];

impl Field {
    /// Reads the field's keys; `centre` and `walls` in rad or m.
    pub(super) fn read(section: &Section<'_>, centre: f64, walls: [Option<f64>; 2]) -> Self {
        let walls = match walls {
            [Some(least), Some(most)] if least < most => Some((least, most)),
            [None, None] => None,
            [Some(_), Some(_)] => {
                let found = "walls the wrong way round";
                let advice = "swap the two";
                section.refuse("wall_max_deg", "more than wall_min_deg", found, advice)
            }
            _ => {
                let advice = "give wall_min and wall_max; one may lie at the limit";
                section.refuse("wall_min_deg", "both walls", "one", advice)
            }
        };
        let wall_stiffness = match walls {
            Some(_) => section.number_or("wall_stiffness", 10.0, WALL),
            None => {
                if section.has("wall_stiffness") {
                    let advice = "add wall_min_deg and wall_max_deg";
                    section.problem("wall_stiffness", "walls", "their stiffness alone", advice);
                    section.number_or_none("wall_stiffness", WALL);
                }
                0.0
            }
        };
        let matrix = Matrix::read(section).map(Box::new);
        if matrix.is_some() {
            for key in
                ["spring", "centre_deg", "centre_m"].into_iter().filter(|key| section.has(key))
            {
                let advice = "put the spring into the matrix, its centre into centres_deg";
                section.problem(key, "one of spring and matrix", "both", advice);
            }
        }
        Self {
            stiffness: section.number_or("spring", 0.0, SPRING),
            damping: section.number_or("damper", 0.0, DAMPER),
            inertia: section.number_or("inertia", 0.0, INERTIA),
            position_table: TorqueTable::of_positions(section).map(Box::new),
            velocity_table: TorqueTable::of_velocities(section).map(Box::new),
            matrix,
            centre,
            walls,
            wall_stiffness,
        }
    }

    /// Torque of spring, table and walls on an axis at rest there (N·m or N); matrices left out.
    pub fn torque(&self, position: f64) -> f64 {
        let spring = -self.stiffness * (position - self.centre);
        let table = self.position_table.as_ref().map_or(0.0, |table| table.at(position));
        let wall = self.walls.map_or(0.0, |(least, most)| position.max(least).min(most) - position);
        spring + table + self.wall_stiffness * wall
    }

    /// Lowest and highest stiffness (N·m/rad or N/m) and damping (N·m·s/rad or N·s/m) anywhere, for
    /// the check of stability on its own axis; matrices left out.
    pub fn extremes(&self) -> [(f64, f64); 2] {
        // A table's slope is the negative of a stiffness; beyond its ends it is 0.
        let range = |table: &Option<Box<TorqueTable>>| {
            table.as_ref().map_or((0.0, 0.0), |table| {
                let (least, most) = table.slopes();
                (f64::min(-most, 0.0), f64::max(-least, 0.0))
            })
        };
        let (position, velocity) = (range(&self.position_table), range(&self.velocity_table));
        [
            (self.stiffness + position.0, self.stiffness + position.1 + self.wall_stiffness),
            (self.damping + velocity.0, self.damping + velocity.1),
        ]
    }

    /// Largest torque at rest within limits (N·m or N), and its position (rad or m).
    pub fn largest_torque(&self, least: f64, most: f64) -> (f64, f64) {
        // The torque is linear between the walls, the table's points and the limits, so the largest
        // is at one of them.
        let edges = self.walls.map_or([least, most], |(low, high)| [low, high]);
        [least, most]
            .into_iter()
            .chain(edges)
            .chain(self.position_table.iter().flat_map(|table| table.places()))
            .filter(|at| (least..=most).contains(at))
            .map(|at| (self.torque(at), at))
            .max_by(|a, b| a.0.abs().total_cmp(&b.0.abs()))
            .unwrap_or((0.0, least))
    }
}

/// The unit symbol of a torque on an axis of that unit.
pub(super) const fn torque_symbol(unit: AxisUnit) -> &'static str {
    unit.choose("N·m", "N")
}

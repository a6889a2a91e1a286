//! The other axes at a shared handle, and their recorded accelerations.

use plant::coupled_axes::HandleCoupling;
use recording::record::column_of;
use rig::RigFile;

use super::motion::Motion;
use crate::input::Series;

/// Half the span of the parabola whose curvature is the acceleration (s). A longer one loses the
/// peaks where the slave breaks loose, and the product of inertia comes out too large to make up
/// for them: by 1 to 2 % at 2 ms, 4 to 6 % at 4 ms and 14 to 15 % at 8 ms, for records of the
/// calibrated plant. The noise of a short one hardly shows: integrated twice, it moves the slave by
/// a part of a count.
const REACH_S: f64 = 2e-3;

/// Another axis at the same handle, as a rig file declares it.
#[derive(Clone, Debug, PartialEq)]
pub struct OtherAxis {
    /// Its index in the rig file.
    pub index: usize,
    /// Its name.
    pub name: String,
    /// Its product of inertia with the axis identified (kg·m²).
    pub coupling_kg_m2: f64,
}

impl OtherAxis {
    /// The axes of a rig beside one of them.
    pub fn beside(rig: &RigFile, axis: usize) -> Vec<Self> {
        let handle = HandleCoupling::of_pairs(rig.axes.len(), &rig.model.handle_coupling);
        let handle = handle.unwrap_or_default();
        let others = rig.axes.iter().enumerate().filter(|(index, _)| *index != axis);
        let of = |(index, other): (usize, &rig::Axis)| Self {
            index,
            name: other.name.clone(),
            coupling_kg_m2: handle.between(axis, index),
        };
        others.map(of).collect()
    }

    /// The column of a record that has the position of its slave.
    pub fn column(&self) -> String {
        column_of(&self.name, "slave_rad")
    }

    /// Whether a column of a record is one of this axis.
    pub fn has(&self, column: &str) -> bool {
        column.starts_with(&column_of(&self.name, ""))
    }

    /// Name of its product of inertia as a parameter.
    pub fn parameter(&self) -> String {
        format!("{HANDLE_COUPLING}.{}", self.name)
    }
}

/// The key of a rig file that declares the products of inertia.
pub const HANDLE_COUPLING: &str = "handle_coupling_kg_m2";

/// Whether a parameter is a product of inertia with another axis ([`OtherAxis::parameter`]), which
/// the transmission by itself does not have.
pub fn is_handle_coupling(parameter: &str) -> bool {
    parameter.starts_with(HANDLE_COUPLING)
}

/// The recorded acceleration of another axis's slave.
#[derive(Clone, Debug, PartialEq)]
pub struct OtherAcceleration {
    /// Index of the axis in the rig file.
    pub axis: usize,
    /// Mean from each row to the next (rad/s²).
    pub rad_s2: Vec<f64>,
}

/// The accelerations of the other axes that a record has.
pub(super) fn accelerations(
    series: &Series,
    step_s: f64,
    others: &[OtherAxis],
) -> Vec<OtherAcceleration> {
    let of = |other: &OtherAxis| {
        let at_rows = Motion::within(series.column(&other.column())?, step_s, REACH_S).acceleration;
        let next = at_rows.iter().skip(1).chain(at_rows.last());
        let rad_s2 = at_rows.iter().zip(next).map(|(here, next)| 0.5 * (here + next)).collect();
        Some(OtherAcceleration { axis: other.index, rad_s2 })
    };
    others.iter().filter_map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rig(name: &str) -> RigFile {
        let path = format!("{}/../../launch/rigs/{name}.toml", env!("CARGO_MANIFEST_DIR"));
        RigFile::load(path).unwrap()
    }

    #[test]
    fn the_others_come_with_their_products_of_inertia() {
        let of = |axis: usize| -> Vec<(usize, f64)> {
            let others = OtherAxis::beside(&rig("three-axis"), axis);
            others.iter().map(|other| (other.index, other.coupling_kg_m2)).collect()
        };
        assert_eq!(of(0), [(1, 2e-4), (2, 1e-4)]);
        assert_eq!(of(1), [(0, 2e-4), (2, -1e-4)]);
        assert_eq!(of(2), [(0, 1e-4), (1, -1e-4)]);
        assert!(OtherAxis::beside(&rig("hydrostatic"), 0).is_empty());
        // A file that declares a model alone has no axes.
        let text = "[model]\nkind = \"oscillator\"\n";
        let alone = RigFile::parse_declaration(text, "alone.toml").unwrap();
        assert!(OtherAxis::beside(&alone, 0).is_empty());
    }

    /// The torque from a row to the next is that of the mean acceleration, so that the speed it
    /// gives the slave is that of the other axis, whatever the rate.
    #[test]
    fn accelerations_add_up_to_the_change_of_speed() {
        let (step_s, rows) = (5e-4, 2000);
        let speed = |t: f64| 3.0 * t * t;
        let [other, _] = &OtherAxis::beside(&rig("three-axis"), 0)[..] else { panic!() };
        let column = (0..rows).map(|row| (f64::from(row) * step_s).powi(3)).collect();
        let series = Series { columns: vec![(other.column(), column)], ..Series::default() };
        let found = accelerations(&series, step_s, std::slice::from_ref(other));
        assert_eq!((found.len(), found[0].axis), (1, 1));
        let (from, to) = (100, 1900);
        let sum: f64 = found[0].rad_s2[from..to].iter().map(|mean| mean * step_s).sum();
        let expected = speed(to as f64 * step_s) - speed(from as f64 * step_s);
        assert!((sum / expected - 1.0).abs() < 1e-6, "{sum} {expected}");
    }

    #[test]
    fn a_column_belongs_to_the_axis_whose_name_it_begins_with() {
        let other = OtherAxis { index: 1, name: "turn".to_owned(), coupling_kg_m2: 0.0 };
        assert_eq!(other.column(), "turn.slave_rad");
        assert!(other.has("turn.motor_v") && !other.has("turning.motor_v") && !other.has("turn"));
    }
}

//! The unit of an axis, and the keys of a rig file whose names carry it.

use crate::checked_toml::Section;

/// Unit of an axis's positions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AxisUnit {
    /// Rotary: positions in rad, torques in N·m. Files give degrees.
    Radian,
    /// Linear: positions in m, forces in N.
    Metre,
}

impl AxisUnit {
    /// Chooses between the value for a rotary and that for a linear axis.
    pub(crate) const fn choose<T: Copy>(self, radian: T, metre: T) -> T {
        match self {
            Self::Radian => radian,
            Self::Metre => metre,
        }
    }

    /// The unit's symbol.
    pub const fn symbol(self) -> &'static str {
        self.choose("rad", "m")
    }

    /// Factor from the file's unit to SI: degrees to rad, m to m.
    pub(crate) const fn si_per_file_unit(self) -> f64 {
        self.choose(std::f64::consts::PI / 180.0, 1.0)
    }

    /// Returns the name in this unit of a key that has one for each; reports the other if present.
    pub(crate) fn key(self, section: &Section<'_>, names: KeyNames) -> &'static str {
        let KeyNames(radian, metre) = names;
        let (right, wrong) = self.choose((radian, metre), (metre, radian));
        if section.has(wrong) {
            let expected = format!("`{right}`, as the axis's unit is \"{}\"", self.symbol());
            section.misplaced(wrong, &expected, "convert the value, or change the axis's unit");
        }
        right
    }
}

/// The names of a key on a rotary and on a linear axis.
#[derive(Clone, Copy)]
pub(crate) struct KeyNames(pub(crate) &'static str, pub(crate) &'static str);

impl KeyNames {
    pub(crate) const fn of(self, unit: AxisUnit) -> &'static str {
        unit.choose(self.0, self.1)
    }
}

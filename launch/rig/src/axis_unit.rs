//! The unit of an axis, and the keys of a rig file whose names carry it.

use crate::read::{Bounds, Section};

/// Unit of an axis's positions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AxisUnit {
    /// Rotary: positions in rad, torques in N·m. Files give degrees.
    Radian,
    /// Linear: positions in m, forces in N.
    Metre,
}

impl AxisUnit {
    /// The unit's symbol.
    pub const fn symbol(self) -> &'static str {
        match self {
            Self::Radian => "rad",
            Self::Metre => "m",
        }
    }

    /// Factor from the file's unit to SI: degrees to rad, m to m.
    pub(crate) const fn si_per_file_unit(self) -> f64 {
        match self {
            Self::Radian => std::f64::consts::PI / 180.0,
            Self::Metre => 1.0,
        }
    }
}

/// The keys whose names end in the axis's unit.
pub(crate) struct KeyNames {
    pub(crate) counts: &'static str,
    pub(crate) position_min: &'static str,
    pub(crate) position_max: &'static str,
    pub(crate) speed: &'static str,
    pub(crate) torque: &'static str,
    pub(crate) sensitivity: &'static str,
    pub(crate) inertia: &'static str,
}

const RADIAN: KeyNames = KeyNames {
    counts: "counts_per_turn",
    position_min: "position_min_deg",
    position_max: "position_max_deg",
    speed: "speed_max_deg_s",
    torque: "torque_max_nm",
    sensitivity: "volts_per_nm",
    inertia: "inertia_v_per_rad_s2",
};
const METRE: KeyNames = KeyNames {
    counts: "counts_per_metre",
    position_min: "position_min_m",
    position_max: "position_max_m",
    speed: "speed_max_m_s",
    torque: "force_max_n",
    sensitivity: "volts_per_n",
    inertia: "inertia_v_per_m_s2",
};

/// The key names of an axis's unit, and those of the other unit, which are refused.
pub(crate) struct AxisKeys {
    pub(crate) unit: AxisUnit,
    pub(crate) names: KeyNames,
    other: KeyNames,
}

impl AxisKeys {
    pub(crate) fn new(unit: AxisUnit) -> Self {
        match unit {
            AxisUnit::Radian => Self { unit, names: RADIAN, other: METRE },
            AxisUnit::Metre => Self { unit, names: METRE, other: RADIAN },
        }
    }

    /// The bounds that belong to the axis's unit.
    pub(crate) fn choose(&self, radian: Bounds, metre: Bounds) -> Bounds {
        match self.unit {
            AxisUnit::Radian => radian,
            AxisUnit::Metre => metre,
        }
    }

    /// Returns the name of a key in the axis's unit; reports the key of the other unit if present.
    pub(crate) fn key(
        &self,
        section: &Section<'_>,
        of: impl Fn(&KeyNames) -> &'static str,
    ) -> &'static str {
        let (right, wrong) = (of(&self.names), of(&self.other));
        if section.has(wrong) {
            let expected = format!("`{right}`, as the axis's unit is \"{}\"", self.unit.symbol());
            section.misplaced(wrong, &expected, "convert the value, or change the axis's unit");
        }
        right
    }
}

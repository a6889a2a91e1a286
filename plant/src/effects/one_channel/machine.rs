//! The machine of a one-channel model: units, and the ranges of its records, by which effects are
//! scaled.

/// Names of the units of a machine: a linear axis, a rotary axis or a circuit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Units {
    /// `N` or `N·m`.
    pub force: &'static str,
    /// `m` or `rad`.
    pub position: &'static str,
    /// `m/s` or `rad/s`.
    pub velocity: &'static str,
    /// `N/m` or `N·m/rad`.
    pub stiffness: &'static str,
    /// `N·s/m` or `N·m·s/rad`.
    pub damping: &'static str,
    /// `kg` or `kg·m²`.
    pub mass: &'static str,
}

impl Units {
    /// A linear axis.
    pub const LINEAR: Self = Self {
        force: "N",
        position: "m",
        velocity: "m/s",
        stiffness: "N/m",
        damping: "N·s/m",
        mass: "kg",
    };
    /// A rotary axis.
    pub const ROTARY: Self = Self {
        force: "N·m",
        position: "rad",
        velocity: "rad/s",
        stiffness: "N·m/rad",
        damping: "N·m·s/rad",
        mass: "kg·m²",
    };
    /// A circuit whose input and output are voltages.
    pub const VOLTS: Self = Self {
        force: "V",
        position: "V",
        velocity: "V/s",
        stiffness: "1",
        damping: "s",
        mass: "s²",
    };
}

/// Units of the axis, and the ranges of the records, by which effects are scaled.
#[derive(Clone, Copy, Debug)]
pub struct Axis {
    /// Names of units.
    pub units: Units,
    /// Whether the position is an angle.
    pub rotary: bool,
    /// Position per motor turn, where it is declared; one turn of a rotary axis is 2π rad.
    pub turn: Option<f64>,
    /// Whether the declared model has a stiffness.
    pub spring: bool,
    /// Whether the force column is the command to an amplifier rather than a measured force.
    pub commanded: bool,
    /// Lowest and highest position.
    pub positions: (f64, f64),
    /// Root mean square of the velocity over all records.
    pub velocity_rms: f64,
    /// Largest magnitude of the velocity.
    pub velocity_peak: f64,
    /// Root mean square of the force.
    pub force_rms: f64,
    /// Largest magnitude of the force.
    pub force_peak: f64,
    /// Longest record (s).
    pub seconds: f64,
    /// Cut-off frequency of the low-pass (Hz).
    pub cut_off: f64,
}

impl Axis {
    /// Range of the position.
    pub fn travel(&self) -> f64 {
        self.positions.1 - self.positions.0
    }
}

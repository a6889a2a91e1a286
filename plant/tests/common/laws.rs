//! Every friction law behind one interface: those of [`plant::friction`], and Dahl's law, a
//! [`Bristle`] whose level and stiffness do not change.

use plant::friction::{
    Asymmetric, Bristle, Coulomb, FrictionLaw, Load, LoadDependent, OperatingPoint,
    PositionDependent, Stribeck, StribeckCurve, Viscous,
};
use plant::{ParameterInfo, ParameterSet};

/// A law, with or without memory.
pub trait Law {
    fn contribute(&mut self, load: &mut Load, at: &OperatingPoint);

    /// Updates a law with memory by the displacement of the step.
    fn settle(&mut self, _displacement: f64) {}

    /// Resets the memory.
    fn reset(&mut self) {}

    /// Energy that its bristles hold, J.
    fn stored_j(&self) -> f64 {
        0.0
    }

    fn set(&mut self, name: &str, value: f64);
}

impl<L: FrictionLaw> Law for L {
    fn contribute(&mut self, load: &mut Load, at: &OperatingPoint) {
        FrictionLaw::contribute(self, load, at);
    }

    fn set(&mut self, name: &str, value: f64) {
        ParameterSet::set(self, name, value).unwrap();
    }
}

/// Dahl's law: `dF/dq = σ (1 - F sgn(q̇) / F_c)`.
#[derive(Clone, Debug)]
pub struct Dahl {
    pub level: f64,
    pub stiffness: f64,
    pub bristle: Bristle,
}

impl Dahl {
    pub fn new(level: f64, stiffness: f64) -> Self {
        Self { level, stiffness, bristle: Bristle::default() }
    }
}

impl Default for Dahl {
    fn default() -> Self {
        Self::new(DAHL[0].printed, DAHL[1].printed)
    }
}

const fn info(name: &'static str, maximum: f64, printed: f64) -> ParameterInfo {
    ParameterInfo { name, unit: "1", minimum: 1e-6, maximum, printed, source: "" }
}

const DAHL: &[ParameterInfo] = &[info("level", 1e4, 0.95), info("stiffness", 1e9, 50.0)];

impl Law for Dahl {
    fn contribute(&mut self, load: &mut Load, at: &OperatingPoint) {
        self.bristle.contribute(load, self.stiffness, self.level, at);
    }

    fn settle(&mut self, displacement: f64) {
        self.bristle.settle(displacement);
    }

    fn reset(&mut self) {
        self.bristle = Bristle::default();
    }

    fn stored_j(&self) -> f64 {
        0.5 * self.stiffness * self.bristle.deflection().powi(2)
    }

    fn set(&mut self, name: &str, value: f64) {
        *(if name == "level" { &mut self.level } else { &mut self.stiffness }) = value;
    }
}

/// One law of [`LAWS`].
#[derive(Clone, Copy, Debug)]
pub struct LawEntry {
    pub name: &'static str,
    pub parameters: &'static [ParameterInfo],
    /// Whether friction is equal in both directions.
    pub symmetric: bool,
    /// Whether it yields elastically before sliding, instead of exact stick.
    pub presliding: bool,
    pub build: fn() -> Box<dyn Law>,
}

const fn entry(
    name: &'static str,
    parameters: &'static [ParameterInfo],
    symmetric: bool,
    build: fn() -> Box<dyn Law>,
) -> LawEntry {
    LawEntry { name, parameters, symmetric, presliding: false, build }
}

fn default<L: Law + Default + 'static>() -> Box<dyn Law> {
    Box::new(L::default())
}

pub const LAWS: &[LawEntry] = &[
    entry("coulomb", Coulomb::NAMES, true, default::<Coulomb>),
    entry("viscous", Viscous::NAMES, true, default::<Viscous>),
    entry("stribeck", StribeckCurve::NAMES, true, default::<StribeckCurve>),
    entry("piecewise_linear", Stribeck::NAMES, true, default::<Stribeck>),
    entry("asymmetric", Asymmetric::NAMES, false, default::<Asymmetric>),
    entry("position_dependent", PositionDependent::NAMES, false, default::<PositionDependent>),
    entry("load_dependent", LoadDependent::NAMES, true, default::<LoadDependent>),
    LawEntry { presliding: true, ..entry("dahl", DAHL, true, default::<Dahl>) },
];

/// The force with which a law resists a movement that is imposed for one step, N·m or N: positive
/// against positive movement. At no speed a dry law gives 0 (its force there is whatever holds),
/// bristles their spring's force.
pub fn resistance(law: &mut dyn Law, at: &OperatingPoint) -> f64 {
    let mut load = Load::default();
    law.contribute(&mut load, at);
    law.settle(at.velocity * at.step);
    let moving = if at.velocity > 0.0 {
        load.dry.forward.max(0.0) + load.viscous_forward * at.velocity
    } else if at.velocity < 0.0 {
        -load.dry.backward.max(0.0) + load.viscous_backward * at.velocity
    } else {
        0.0
    };
    moving - load.force
}

//! Friction laws by name.

use super::{
    Asymmetric, Coulomb, Dahl, FrictionLaw, LoadDependent, LuGre, PositionDependent, Stribeck,
    StribeckCurve,
};
use crate::ParameterInfo;
use crate::friction::Viscous;

/// One law of [`LAWS`].
#[derive(Clone, Copy, Debug)]
pub struct LawEntry {
    /// Its name.
    pub name: &'static str,
    /// What it is.
    pub what: &'static str,
    /// Where it comes from.
    pub source: &'static str,
    /// Its parameters, each with unit, range, default and source.
    pub parameters: &'static [ParameterInfo],
    /// Whether friction is equal in both directions.
    pub symmetric: bool,
    /// Whether it yields elastically before sliding, instead of exact stick.
    pub presliding: bool,
    build: fn() -> Box<dyn FrictionLaw>,
}

impl LawEntry {
    /// The law with its default parameters.
    pub fn build(&self) -> Box<dyn FrictionLaw> {
        (self.build)()
    }
}

macro_rules! laws {
    ($($name:literal $type:ident $symmetry:ident $kind:ident $what:literal, $source:literal;)+) => {
        /// Every law, the simple ones first. Names are an interface.
        pub const LAWS: &[LawEntry] = &[$(LawEntry {
            name: $name,
            what: $what,
            source: $source,
            parameters: $type::NAMES,
            symmetric: laws!(@ $symmetry),
            presliding: laws!(@ $kind),
            build: || Box::new($type::default()),
        }),+];
    };
    (@ symmetric) => { true };
    (@ asymmetric) => { false };
    (@ presliding) => { true };
    (@ rigid) => { false };
}

laws! {
    "coulomb" Coulomb symmetric rigid
        "dry friction, the same at any speed",
        "Coulomb 1785; § 3.2.1 (motor)";
    "viscous" Viscous symmetric rigid
        "friction proportional to speed",
        "§ 3.2.1 (motor)";
    "stribeck" StribeckCurve symmetric rigid
        "dry friction that falls smoothly with speed from breakaway to kinetic (Gaussian, Tustin)",
        "Armstrong-Hélouvry, Dupont, Canudas de Wit, Automatica 30 (1994)";
    "piecewise_linear" Stribeck symmetric rigid
        "dry friction that falls to a corner speed and then rises, in straight lines",
        "§ 3.2.1, fig. 3.2B";
    "asymmetric" Asymmetric asymmetric rigid
        "dry and viscous friction that differ by direction",
        "§ 5.2.2: 0.9 N m forward, 1.0 N m backward";
    "position_dependent" PositionDependent asymmetric rigid
        "dry friction that varies along the stroke",
        "§ 5.2.2, fig. 5.5";
    "load_dependent" LoadDependent symmetric rigid
        "dry friction that grows with the transmitted load and saturates",
        "§ 5.2.2, fig. 5.6";
    "dahl" Dahl symmetric presliding
        "bristles: friction that builds up over a small travel",
        "Dahl, Aerospace Corporation TOR-0158(3107-18)-1 (1968)";
    "lugre" LuGre symmetric presliding
        "bristles with Stribeck curve and viscous friction",
        "Canudas de Wit, Olsson, Åström, Lischinsky, IEEE TAC 40 (1995)";
}

/// The law of that name.
pub fn find(name: &str) -> Option<&'static LawEntry> {
    LAWS.iter().find(|entry| entry.name == name)
}

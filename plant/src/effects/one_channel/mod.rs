//! Effects in models of one channel (drives, elements, oscillators): a force that the motion
//! requires beside the declared one, linear in some amplitudes, as columns of a regression that are
//! computed from the measured motion.

mod fitted;
mod machine;
mod parameters;
pub mod samples;

pub use fitted::{DeclaredFit, FittedEffect, Quantity};
pub use machine::{Axis, Units};
pub use parameters::{Declared, Shape, Spacing, Term};

/// Columns of a regression from the signals of a record and the effect's shapes.
type Columns = fn(&View<'_>, &[f64]) -> Vec<Vec<f64>>;

/// Force per unit amplitude at an instant, from the effect's shapes and states: one value per term,
/// positive against the input.
type Force = fn(&Instant, &[f64], &[f64], &mut [f64]);

/// Output of an amplifier for a command sampled at a step (s), from amplitudes and shapes.
type Deliver = fn(&[f64], f64, &[f64], &[f64]) -> Vec<f64>;

/// Parameters of the plant's effect from those of a fit.
type OfPlant = for<'a> fn(&FittedEffect<'a>) -> Option<Vec<Quantity<'a>>>;

/// An effect of drives, elements and oscillators, as its own file declares it.
///
/// Columns are functions of the filtered motion. Nonlinear ones are low-passed by the caller: the
/// measured force is low-passed too, so that both sides of the balance have passed the same filter.
#[derive(Clone, Copy, Debug)]
pub struct OneChannel {
    /// Fixed id, as in rig files and results; given by [`Entry`](super::Entry).
    pub id: &'static str,
    /// Names of the sites at which it may act; given by [`Entry`](super::Entry).
    pub sites: &'static [&'static str],
    /// Place in the order in which effects are tried, which decides between equal gains: the lowest
    /// first, then those that declare none.
    pub rank: u8,
    /// A description that completes "The model lacks ...".
    pub words: &'static str,
    /// The experiment that would settle what one run leaves open about it.
    pub experiment: &'static str,
    /// Effects that must be in the model already, because without them this one would imitate them.
    pub needs: &'static [&'static str],
    /// The simpler effect that this one contains as a limiting case. Where the simpler one explains
    /// as much, it is chosen, and the two are not reported as rivals.
    pub refines: Option<&'static str>,
    /// The declared parameter whose bounds it lifts, for effects that act like a changed parameter.
    /// Such an effect is a candidate only where the fitted value is at the bound of its tolerance;
    /// where the parameter is not declared, the effect has a column of its own.
    pub lifts: Option<Declared>,
    /// The declared parameter that is the same: where it is declared, the model has the effect.
    pub same_as: Option<Declared>,
    /// Whether it can occur on an axis.
    pub applies: fn(&Axis) -> bool,
    /// Whether its columns depend on the smoothed sign of the velocity.
    pub uses_sign: bool,
    /// Whether its columns are computed from the force that the model predicts.
    pub uses_model: bool,
    /// Whether its columns are linear in signals that are already low-passed.
    pub linear: bool,
    /// Whether its columns are a sine and a cosine of time, with the frequency as the only shape.
    pub is_tone: bool,
    /// Whether it may be added more than once, as waves of several orders.
    pub repeats: bool,
    /// Whether it is also searched beside a nonparametric function: friction, gravity and mass,
    /// which nearly every machine has.
    pub beside_functions: bool,
    /// The time (s) by which it shifts the force, from amplitudes and shapes, for effects that do
    /// nothing else. A shift of about one sampling period is caused by sampling and zero-order hold
    /// and is not reported as an effect.
    pub shift: fn(&[f64], &[f64]) -> Option<f64>,
    /// Linear amplitudes.
    pub terms: fn(&Axis) -> Vec<Term>,
    /// Nonlinear parameters.
    pub shapes: fn(&Axis) -> Vec<Shape>,
    /// One column per term at the full rate, for effects whose columns are not [`Self::force`] at
    /// each row.
    pub columns: Option<Columns>,
    /// Number of states of its own in the simulation; they start at 0.
    pub states: usize,
    /// Their time derivative, from the motion, the shapes and the states.
    pub rates: fn(&Instant, &[f64], &[f64], &mut [f64]),
    /// The effect as a force at an instant, if it can be written as one.
    pub force: Option<Force>,
    /// What the amplifier puts out, for effects of the amplifier.
    pub deliver: Option<Deliver>,
    /// The parameters of the plant's effect of the same id, in its names and units; none where that
    /// means something else.
    pub of_plant: OfPlant,
}

impl OneChannel {
    /// Without terms: what an effect does not declare.
    pub const NONE: Self = Self {
        id: "",
        sites: &[],
        rank: u8::MAX,
        words: "",
        experiment: "",
        needs: &[],
        refines: None,
        lifts: None,
        same_as: None,
        applies: |_| true,
        uses_sign: false,
        uses_model: false,
        linear: false,
        is_tone: false,
        repeats: false,
        beside_functions: false,
        shift: |_, _| None,
        terms: |_| Vec::new(),
        shapes: |_| Vec::new(),
        columns: None,
        states: 0,
        rates: |_, _, _, _| (),
        force: None,
        deliver: None,
        of_plant: |_| None,
    };

    /// Without terms, of that name and at those sites.
    pub const fn named(id: &'static str, sites: &'static [&'static str]) -> Self {
        Self { id, sites, ..Self::NONE }
    }

    /// Whether it takes a part of the measured force away, instead of adding a force that the
    /// motion needs: one of its columns has a given amplitude and is not computed from the motion.
    pub fn alters_target(&self, axis: &Axis) -> bool {
        !self.uses_model && (self.terms)(axis).iter().any(Term::is_given)
    }
}

/// Filtered motion of one record at its full rate.
#[derive(Clone, Debug)]
pub struct Motion {
    /// Time (s).
    pub time: Vec<f64>,
    /// Position, low-passed (m or rad).
    pub position: Vec<f64>,
    /// Velocity: derivative of the low-passed position (m/s or rad/s).
    pub velocity: Vec<f64>,
    /// Acceleration: second derivative of the low-passed position.
    pub acceleration: Vec<f64>,
    /// Force as recorded (N or N·m).
    pub force: Vec<f64>,
}

/// The signals of a record at the full rate, from which an effect computes its columns.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    /// Filtered motion, and the force as recorded.
    pub signals: &'a Motion,
    /// Smoothed sign of the velocity.
    pub sign: &'a [f64],
    /// The force that the model without this effect predicts from the motion, low-passed; empty
    /// before the first fit.
    pub model: &'a [f64],
    /// Units and scales.
    pub axis: &'a Axis,
}

/// The motion at one instant.
#[derive(Clone, Copy, Debug)]
pub struct Instant {
    /// Time since the start (s).
    pub time: f64,
    /// Position.
    pub position: f64,
    /// Velocity.
    pub velocity: f64,
    /// Smoothed sign of the velocity.
    pub sign: f64,
    /// The force that the rest of the model needs (N or N·m); 0 where it is not known.
    pub load: f64,
}

//! What an effect may do to a machine with one channel.

use super::Kind;
use super::machine::{Demands, Machine};
use crate::effects::{Effect, Site, Values, Variable};
use crate::random::Draw;

/// The motion at an instant.
#[derive(Clone, Copy, Debug, Default)]
pub struct Now {
    /// Time since the start of the record, s.
    pub time_s: f64,
    /// Length of a step, s.
    pub step_s: f64,
    /// Position.
    pub position: f64,
    /// Velocity.
    pub velocity: f64,
    /// Acceleration, of the last step.
    pub acceleration: f64,
    /// Force that inertia, viscous friction, spring and offset need.
    pub load: f64,
}

/// A force against the motion, and dry friction, either way.
#[derive(Clone, Copy, Debug, Default)]
pub struct Acts {
    /// Force that is needed beside the declared one.
    pub force: f64,
    /// Dry friction forward.
    pub forward: f64,
    /// Dry friction backward.
    pub backward: f64,
}

impl Acts {
    /// A force.
    pub fn force(force: f64) -> Self {
        Self { force, ..Self::default() }
    }

    /// Dry friction of both directions.
    pub fn dry(level: f64) -> Self {
        Self { forward: level, backward: level, ..Self::default() }
    }
}

/// A force of the motion.
pub type Acting = Box<dyn FnMut(&Now) -> Acts + Send>;
/// A signal from another, at each step.
pub type Passing = Box<dyn FnMut(f64, &Now) -> f64 + Send>;

/// An effect at work in a record; it may remember.
pub enum Law {
    /// Adds a force or dry friction.
    Acts(Acting),
    /// Adds mass.
    Mass(f64),
    /// What the amplifier delivers for a command.
    Delivers(Passing),
    /// What the force channel shows for a force.
    Measures(Passing),
    /// What the position channel shows for a position.
    Counts(Passing),
}

impl Law {
    /// A force or dry friction.
    pub fn acts(law: impl FnMut(&Now) -> Acts + Send + 'static) -> Self {
        Self::Acts(Box::new(law))
    }

    /// An amplifier.
    pub fn delivers(law: impl FnMut(f64, &Now) -> f64 + Send + 'static) -> Self {
        Self::Delivers(Box::new(law))
    }

    /// A force channel.
    pub fn measures(law: impl FnMut(f64, &Now) -> f64 + Send + 'static) -> Self {
        Self::Measures(Box::new(law))
    }

    /// A position channel.
    pub fn counts(law: impl FnMut(f64, &Now) -> f64 + Send + 'static) -> Self {
        Self::Counts(Box::new(law))
    }
}

/// The machine and its movements without an effect, by which sizes are scaled.
#[derive(Clone, Copy, Debug)]
pub struct Setting<'a> {
    /// The machine.
    pub machine: &'a Machine,
    /// Root mean square of the force.
    pub force_rms: f64,
    /// Largest force.
    pub force_peak: f64,
    /// Range of the position.
    pub travel: f64,
    /// Root mean square of the velocity.
    pub speed_rms: f64,
    /// Largest speed.
    pub speed_peak: f64,
    /// Length of a record, s.
    pub seconds: f64,
}

/// An effect at its site of one kind of machine.
pub struct Entry {
    /// Id.
    pub id: &'static str,
    /// Kinds of machines that may have it, and where.
    pub sites: &'static [(Kind, Site)],
    /// What it demands of the machine.
    pub demands: Demands,
    /// Whether it is of the list.
    pub listed: bool,
    /// Variables on any of which a function may be said to describe it.
    pub depends_on: &'static [Variable],
    /// Draws its parameters, the first of them its size at about a fifth of the force; `None` where
    /// the machine cannot show it.
    pub draw: fn(&mut Draw, &Setting<'_>) -> Option<Values>,
    /// Limits of the first parameter.
    pub limits: fn(&Setting<'_>) -> (f64, f64),
    /// Whether a larger parameter is a smaller effect.
    pub inverse: bool,
    /// Puts it to work.
    pub build: fn(&Values) -> Law,
}

impl Entry {
    /// Where it acts on a kind of machine.
    pub fn site(&self, kind: Kind) -> Option<Site> {
        self.sites.iter().find(|site| site.0 == kind).map(|site| site.1)
    }

    /// With its parameters.
    pub fn effect(&self, kind: Kind, parameters: Values) -> Effect {
        Effect {
            id: self.id.to_owned(),
            site: self.site(kind).unwrap_or(Site::Sensor),
            parameters,
            depends_on: self.depends_on.to_vec(),
            listed: self.listed,
        }
    }
}

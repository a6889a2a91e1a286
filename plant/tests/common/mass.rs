//! A mass under one law of friction.

use plant::friction::{self, Load, OperatingPoint};

use super::laws::Law;

/// A mass under one law.
pub struct Mass {
    pub law: Box<dyn Law>,
    pub inertia: f64,
    pub position: f64,
    pub velocity: f64,
    pub increment: f64,
    pub transmitted: f64,
    /// Work of the force less kinetic energy, since the start, J.
    pub lost_and_stored: f64,
}

impl Mass {
    pub fn new(law: Box<dyn Law>) -> Self {
        let (inertia, transmitted) = (2e-3, 0.0);
        Self {
            law,
            inertia,
            position: 0.0,
            velocity: 0.0,
            increment: 0.0,
            transmitted,
            lost_and_stored: 0.0,
        }
    }

    /// One step; returns what the law lost, J.
    pub fn step(&mut self, force: f64, step: f64) -> f64 {
        let mean = self.velocity + 0.5 * self.increment;
        let at = OperatingPoint {
            position: self.position + 0.5 * step * self.velocity,
            velocity: if mean * self.velocity < 0.0 { 0.0 } else { mean },
            transmitted: self.transmitted,
            step,
        };
        let mut load = Load { inertia: self.inertia, ..Load::default() };
        let stored = self.law.stored_j();
        self.law.contribute(&mut load, &at);
        load.force += force;
        let moved = friction::advance(self.velocity, step, &load);
        self.law.settle(moved.displacement);
        let kinetic = 0.5
            * self.inertia
            * (moved.velocity - self.velocity)
            * (moved.velocity + self.velocity);
        self.increment = if moved.velocity == 0.0 { 0.0 } else { moved.velocity - self.velocity };
        self.position += moved.displacement;
        self.velocity = moved.velocity;
        let lost_and_stored = force * moved.displacement - kinetic;
        self.lost_and_stored += lost_and_stored;
        lost_and_stored - (self.law.stored_j() - stored)
    }
}

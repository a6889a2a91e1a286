//! One degree of freedom over one step, with exact stick.
//!
//! The force other than friction is held over the step. Within the step the movement is then known
//! in closed form, so the instant at which it stops is resolved, and at rest the friction takes any
//! value up to breakaway: the speed is exactly zero, with neither creep nor chatter. A movement
//! that is only slowed is a midpoint rule (second order).

use super::smoothed::{Smoothing, advance_smoothed};

/// Dry friction, N·m or N, as positive magnitudes for movement in either direction.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DryFriction {
    /// Against forward movement at the present speed.
    pub forward: f64,
    /// Against backward movement at the present speed.
    pub backward: f64,
    /// Breakaway, forward.
    pub forward_at_rest: f64,
    /// Breakaway, backward.
    pub backward_at_rest: f64,
}

impl DryFriction {
    /// The same in both directions.
    pub fn symmetric(moving: f64, at_rest: f64) -> Self {
        Self {
            forward: moving,
            backward: moving,
            forward_at_rest: at_rest,
            backward_at_rest: at_rest,
        }
    }

    /// Adds to all four.
    pub fn add(&mut self, moving: f64, at_rest: f64) {
        self.forward += moving;
        self.backward += moving;
        self.forward_at_rest += at_rest;
        self.backward_at_rest += at_rest;
    }

    /// Multiplies all four.
    pub fn scale(&mut self, factor: f64) {
        self.forward *= factor;
        self.backward *= factor;
        self.forward_at_rest *= factor;
        self.backward_at_rest *= factor;
    }
}

/// All that acts on one degree of freedom during a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Load {
    /// Force other than friction, N·m or N.
    pub force: f64,
    /// Inertia, kg·m² or kg.
    pub inertia: f64,
    /// Viscous coefficient of forward movement, N·m·s/rad or N·s/m.
    pub viscous_forward: f64,
    /// Viscous coefficient of backward movement.
    pub viscous_backward: f64,
    /// Dry friction.
    pub dry: DryFriction,
    /// How the dry friction passes through zero speed; exact stick by default.
    pub smoothing: Smoothing,
}

/// What one degree of freedom did during a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Advance {
    /// Speed at the end.
    pub velocity: f64,
    /// Change of position.
    pub displacement: f64,
    /// Energy lost to dry and viscous friction, J.
    pub dissipated: f64,
}

/// Advances one degree of freedom that moves at `velocity` by `step` seconds.
#[inline(always)]
pub fn advance(velocity: f64, step: f64, load: &Load) -> Advance {
    if load.smoothing.speed > 0.0 {
        return advance_smoothed(velocity, step, load);
    }
    if velocity == 0.0 {
        return start(step, load);
    }
    // Mirrored, so that the movement is forward.
    let forward = velocity > 0.0;
    let speed = velocity.abs();
    let sign = if forward { 1.0 } else { -1.0 };
    let viscous = if forward { load.viscous_forward } else { load.viscous_backward };
    let level = (if forward { load.dry.forward } else { load.dry.backward }).max(0.0);
    let driving = sign * load.force;

    let half = 0.5 * step * viscous;
    let sliding =
        ((load.inertia - half) * speed + step * (driving - level)) / (load.inertia + half);
    if sliding >= 0.0 {
        let mean = 0.5 * (speed + sliding);
        let displacement = step * mean;
        return Advance {
            velocity: sign * sliding,
            displacement: sign * displacement,
            dissipated: (level + viscous * mean) * displacement,
        };
    }
    // Stops within the step.
    let mean = 0.5 * speed;
    let stopping_time = (load.inertia * speed / (level - driving + viscous * mean)).min(step);
    let displacement = stopping_time * mean;
    let rest = start(step - stopping_time, load);
    Advance {
        velocity: rest.velocity,
        displacement: sign * displacement + rest.displacement,
        dissipated: (level + viscous * mean) * displacement + rest.dissipated,
    }
}

/// What it takes to move one degree of freedom along a given path for one step, from `speed` to
/// `speed_next`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Driven {
    /// The movement.
    pub(crate) moved: Advance,
    /// Mean force beside the load's own, N·m or N.
    pub(crate) force: f64,
    /// Its work, J.
    pub(crate) work: f64,
}

/// Moves one degree of freedom by `displacement` in `step` seconds, whatever that takes.
pub(crate) fn impose(
    speed: f64,
    speed_next: f64,
    displacement: f64,
    step: f64,
    load: &Load,
) -> Driven {
    let mean = displacement / step;
    let friction = if displacement >= 0.0 {
        load.dry.forward + load.viscous_forward * mean
    } else {
        -load.dry.backward + load.viscous_backward * mean
    };
    let dissipated = friction * displacement;
    let kinetic = 0.5 * load.inertia * (speed_next * speed_next - speed * speed);
    Driven {
        moved: Advance { velocity: speed_next, displacement, dissipated },
        force: load.inertia * (speed_next - speed) / step + friction - load.force,
        work: kinetic + dissipated - load.force * displacement,
    }
}

/// From rest: stays there, or breaks away.
#[inline(always)]
fn start(step: f64, load: &Load) -> Advance {
    let (excess, sign, level, viscous) = if load.force >= 0.0 {
        let level = load.dry.forward_at_rest.max(0.0);
        (load.force - level, 1.0, level, load.viscous_forward)
    } else {
        let level = load.dry.backward_at_rest.max(0.0);
        (-load.force - level, -1.0, level, load.viscous_backward)
    };
    if excess <= 0.0 {
        return Advance { velocity: 0.0, displacement: 0.0, dissipated: 0.0 };
    }
    let speed = step * excess / (load.inertia + 0.5 * step * viscous);
    let mean = 0.5 * speed;
    let displacement = step * mean;
    Advance {
        velocity: sign * speed,
        displacement: sign * displacement,
        dissipated: (level + viscous * mean) * displacement,
    }
}

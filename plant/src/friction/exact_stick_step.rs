//! One degree of freedom over one step, with exact stick.
//!
//! The force other than friction is held over the step. Within the step the movement is then known
//! in closed form, so the instant at which it stops is resolved, and at rest the friction takes any
//! value up to breakaway: the speed is exactly zero, with neither creep nor chatter. A movement
//! that is only slowed is a midpoint rule (second order).

use super::smoothed::advance_smoothed;
use super::step_load::{Advance, Load};

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

/// Force and work that an imposed motion of one degree of freedom requires in one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Driven {
    /// The movement.
    pub(crate) moved: Advance,
    /// Mean force beside the load's own, N·m or N.
    pub(crate) force: f64,
    /// Its work, J.
    pub(crate) work: f64,
}

/// Moves one degree of freedom by an imposed `displacement` in `step` seconds.
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

//! Dry friction smoothed about zero speed, for estimators that need a gradient.

use super::step_load::{Advance, Load};

/// Speed above which a mass slides, in multiples of the smoothing speed.
const SLIDING: f64 = 3.0;

/// Advances one degree of freedom whose friction is smoothed, implicit in the new speed.
#[inline(always)]
pub(super) fn advance_smoothed(velocity: f64, step: f64, load: &Load) -> Advance {
    let viscous = if velocity >= 0.0 { load.viscous_forward } else { load.viscous_backward };
    let half = 0.5 * step * viscous;
    let (weight, drive) =
        (load.inertia + half, (load.inertia - half) * velocity + step * load.force);
    // Mirrored, so that the new speed is forward.
    let (sign, drive) = (drive.signum(), drive.abs());
    let level = (if sign > 0.0 { load.dry.forward } else { load.dry.backward }).max(0.0);
    let (smoothing, most) = (load.smoothing.speed, step * level);
    let inverse = 1.0 / smoothing;
    // `w v + h F share(v/s) = d` grows and bends down. What full friction leaves lies on the left
    // of the root, and so does what a line through the origin, steeper than friction anywhere,
    // gives: from there Halley's steps lead on without overshooting by much.
    let least = ((drive - most) / weight).max(drive / (weight + most * inverse));
    // Where it slides, full friction is nearly all there is to it; near rest the speed before is
    // the better guess.
    let mut speed = if least > SLIDING * smoothing { least } else { least.max(sign * velocity) };
    for _ in 0..30 {
        let (share, slope, bend) = load.smoothing.share(speed * inverse);
        let off = drive - weight * speed - most * share;
        let slope = weight + most * inverse * slope;
        let bend = most * inverse * inverse * bend;
        let change = off * slope / (slope * slope - off * bend).max(0.5 * slope * slope);
        speed = (speed + change).max(least);
        // What is left is of the order of the cube.
        if change.abs() <= 1e-2 * (speed + smoothing) {
            break;
        }
    }
    // The impulse of dry friction, from the balance.
    let dry = sign * (drive - weight * speed) / step;
    let speed = sign * speed;
    let mean = 0.5 * (velocity + speed);
    let displacement = step * mean;
    Advance { velocity: speed, displacement, dissipated: (dry + viscous * mean) * displacement }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::friction::{DryFriction, Smoothing};

    #[test]
    fn slope_and_bend_are_those_of_the_share() {
        for shape in [-1.0, -0.4, 0.0, 0.3, 1.0] {
            let smoothing = Smoothing { speed: 0.1, shape };
            for x in [0.01, 0.3, 1.0, 2.5, 20.0] {
                let h = 1e-4 * (1.0 + x);
                let (below, here, above) =
                    (smoothing.share(x - h), smoothing.share(x), smoothing.share(x + h));
                assert!((here.1 - (above.0 - below.0) / (2.0 * h)).abs() < 1e-6, "{shape} {x}");
                assert!(
                    (-2.0 * here.2 - (above.1 - below.1) / (2.0 * h)).abs() < 1e-6,
                    "{shape} {x}"
                );
                assert!(here.0 < 1.0 && here.1 > 0.0 && here.2 >= 0.0);
            }
        }
    }

    #[test]
    fn the_new_speed_balances_forces_whatever_came_before() {
        for shape in [-1.0, -0.5, 0.0, 0.5, 1.0] {
            for (velocity, force) in
                [(0.0, 0.4), (0.001, -2.0), (-3.0, 1.5), (0.2, 0.0), (0.05, -1.01), (5.0, 9.0)]
            {
                let load = Load {
                    force,
                    inertia: 2e-3,
                    viscous_forward: 0.01,
                    viscous_backward: 0.02,
                    dry: DryFriction::symmetric(1.0, 1.0),
                    smoothing: Smoothing { speed: 0.05, shape },
                };
                let step = 1e-3;
                let moved = advance_smoothed(velocity, step, &load);
                let mean = 0.5 * (velocity + moved.velocity);
                let viscous = if velocity >= 0.0 { 0.01 } else { 0.02 };
                let x = moved.velocity / 0.05;
                let dry = x.signum() * load.smoothing.share(x.abs()).0;
                let off = load.inertia * (moved.velocity - velocity) / step + viscous * mean + dry
                    - force;
                assert!(off.abs() < 1e-4, "shape {shape}, from {velocity} with {force}: {off}");
            }
        }
    }
}

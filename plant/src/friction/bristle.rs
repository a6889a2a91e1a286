//! An elastic bristle that slips, common to the laws with memory.

use super::{Load, OperatingPoint};

/// A bristle of stiffness `σ` and damping `σ₁` that slips so that its force ends at a level `g`.
///
/// ```text
/// ż = v - c z,  c = σ |v| / g          deflection
/// F = σ z + σ₁ ż                       against movement
/// ```
///
/// Over a step the mean speed `v` is left open and `c` is held, taken at the speed of the
/// [`OperatingPoint`]. Then `z` is known in closed form, the mean force is `A z₀ + B v`, and goes
/// into a [`Load`] as a force and a viscous coefficient: [`super::advance`] finds `v`. That is of
/// second order, stable at any stiffness, and passive: at every instant of the step
///
/// ```text
/// F v - d(σ z²/2)/dt = σ c z² - σ₁ c z v + σ₁ v²  ≥ 0   where σ₁ ≤ 4 g / |v|
/// ```
///
/// The damping is therefore lowered with speed, to `σ₁ / (1 + σ₁ |v| / 4g)`; at rest it is `σ₁`,
/// and in steady sliding (`ż = 0`) it does not matter. Without that, a bristle law gives energy
/// (Olsson, Åström, Canudas de Wit, Gäfvert, Lischinsky, European Journal of Control 4, 1998, lower
/// it for the same reason, in another form).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Bristle {
    /// Deflection `z`, rad or m.
    deflection: f64,
    /// Stiffness of the last contribution, N·m/rad or N/m.
    stiffness: f64,
    /// Update of the deflection, pending the displacement of the step.
    pending: Option<Pending>,
}

/// An update whose displacement is not yet known.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Pending {
    /// Remaining part of the deflection, `exp(-c h)`.
    decay: f64,
    /// Deflection added per displacement, the mean over the step.
    gain: f64,
    /// Predicted displacement.
    travel: f64,
}

impl Bristle {
    /// Adds the bristle's force to a load: stiffness `σ` and damping `σ₁` (N·m·s/rad or N·s/m), and
    /// the level `g` (N·m or N) at which it slips. A level of zero (or less) leaves no bristle.
    pub fn contribute(
        &mut self,
        load: &mut Load,
        stiffness: f64,
        damping: f64,
        level: f64,
        at: &OperatingPoint,
    ) {
        if let Some(pending) = self.pending.take() {
            // Without `settle`, as predicted.
            self.apply(pending, pending.travel);
        }
        if level <= 0.0 || stiffness <= 0.0 {
            *self = Self::default();
            return;
        }
        self.stiffness = stiffness;
        let speed = at.velocity.abs();
        let rate = stiffness * speed / level;
        let damping = damping / (1.0 + 0.25 * damping * speed / level);
        let decay = (-rate * at.step).exp();
        let gain = mean_decay(rate * at.step);
        // Mean deflection over the step: gain z₀ + reach v, with reach = (1 - gain) / c and its
        // limit h / 2.
        let reach = at.step * mean_reach(rate * at.step);
        let elastic = stiffness - damping * rate;
        load.force -= elastic * gain * self.deflection;
        // Equals σ reach + σ₁ gain, and is never negative.
        let viscous = (elastic * reach + damping).max(0.0);
        load.viscous_forward += viscous;
        load.viscous_backward += viscous;
        self.pending = Some(Pending { decay, gain, travel: at.velocity * at.step });
    }

    /// Updates the deflection by the displacement of the step, rad or m.
    pub fn settle(&mut self, displacement: f64) {
        if let Some(pending) = self.pending.take() {
            self.apply(pending, displacement);
        }
    }

    /// Deflection, rad or m.
    pub fn deflection(&self) -> f64 {
        self.deflection
    }

    /// Energy in the bristle, J.
    pub fn stored_j(&self) -> f64 {
        0.5 * self.stiffness * self.deflection * self.deflection
    }

    fn apply(&mut self, pending: Pending, travel: f64) {
        self.deflection = pending.decay * self.deflection + pending.gain * travel;
    }
}

/// `(1 - e^-x) / x`: mean of a decay over a step.
fn mean_decay(x: f64) -> f64 {
    if x > 0.0 { -(-x).exp_m1() / x } else { 1.0 }
}

/// `(1 - (1 - e^-x)/x) / x`: mean of what builds up over a step, over the step.
fn mean_reach(x: f64) -> f64 {
    if x < 1e-3 {
        // The closed form loses its digits here; the next term is x³/120.
        0.5 - x / 6.0 + x * x / 24.0
    } else {
        (1.0 - mean_decay(x)) / x
    }
}

#[cfg(test)]
mod tests {
    use super::{mean_decay, mean_reach};

    #[test]
    fn series_and_closed_form_meet() {
        for x in [1e-3_f64, 1.01e-3, 2e-3] {
            let series = 0.5 - x / 6.0 + x * x / 24.0 - x * x * x / 120.0;
            assert!((mean_reach(x) - series).abs() < 1e-11, "{x}");
        }
        assert_eq!(mean_reach(0.0), 0.5);
        assert_eq!(mean_decay(0.0), 1.0);
        // A step in which the bristle is long worn off: its mean deflection is that of steady
        // sliding, 1 / c.
        assert!((1e6 * mean_reach(1e6) - 1.0).abs() < 1e-5);
    }
}

//! An elastic bristle that slips: friction with memory (Dahl 1968).

use super::{Load, OperatingPoint};

/// A bristle of stiffness `σ` that slips so that its force ends at a level `g`.
///
/// ```text
/// ż = v - c z,  c = σ |v| / g          deflection
/// F = σ z                              against movement
/// ```
///
/// Over a step the mean speed `v` is left open and `c` is held, taken at the speed of the
/// [`OperatingPoint`]. Then `z` is known in closed form, the mean force is `A z₀ + B v`, and goes
/// into a [`Load`] as a force and a viscous coefficient: [`super::advance`] finds `v`. That is of
/// second order, stable at any stiffness, and passive: at every instant of the step
/// `F v - d(σ z²/2)/dt = σ c z² ≥ 0`. A bristle does not stick exactly: under a constant force
/// below the level it ends at a deflection, under one that also shakes it creeps on (Dupont,
/// Hayward, Armstrong, Altpeter, IEEE TAC 47, 2002).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Bristle {
    /// Deflection `z`, rad or m.
    deflection: f64,
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
    /// Adds the bristle's force to a load: stiffness `σ` (N·m/rad or N/m), and the level `g` (N·m
    /// or N) at which it slips. A level of zero (or less) leaves no bristle.
    pub fn contribute(&mut self, load: &mut Load, stiffness: f64, level: f64, at: &OperatingPoint) {
        if let Some(pending) = self.pending.take() {
            // Without `settle`, as predicted.
            self.apply(pending, pending.travel);
        }
        if level <= 0.0 || stiffness <= 0.0 {
            *self = Self::default();
            return;
        }
        let rate = stiffness * at.velocity.abs() / level;
        let decay = (-rate * at.step).exp();
        let gain = mean_decay(rate * at.step);
        // Mean deflection over the step: gain z₀ + reach v, with reach = (1 - gain) / c and its
        // limit h / 2.
        let reach = at.step * mean_reach(rate * at.step);
        load.force -= stiffness * gain * self.deflection;
        load.viscous_forward += stiffness * reach;
        load.viscous_backward += stiffness * reach;
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

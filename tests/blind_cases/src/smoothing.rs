//! How dry friction passes through zero speed.
//!
//! A simulator with fixed steps cannot have discontinuous friction; it has `F g(v/v_e)` with `g`
//! from -1 to 1. The shape of `g` in a real machine is unknown, so it differs between cases: half
//! of the clean ones have a shape that the model under test does not have (its own is the root).

use serde::{Deserialize, Serialize};

use crate::random::Draw;

/// Shape of the transition.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Shape {
    /// `x/√(1 + x²)`.
    #[default]
    Root,
    /// `tanh x`.
    Tanh,
    /// `x/(1 + x⁴)^¼`: a sharper corner.
    Quartic,
    /// `x/(1 + |x|)`: a slow approach.
    Hyperbola,
    /// `(2/π) atan(π x/2)`: a slower one.
    Arctangent,
    /// `x/√(1 + x²)` times `1 - 0.15 exp(-|x|/4)`: the static value is reached only at some speed,
    /// without the full peak of the falling branch.
    RoundedStart,
}

/// Shape and speed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Smoothing {
    /// Shape.
    pub shape: Shape,
    /// `v_e`, rad/s.
    pub speed_rad_s: f64,
}

impl Smoothing {
    /// For a case with an effect: the shape of the model or a similar one.
    pub fn common(draw: &mut Draw) -> Self {
        Self { shape: draw.choose(&[Shape::Root, Shape::Root, Shape::Tanh]), ..Self::plain(draw) }
    }

    /// For the plain half of the clean cases: the shape of the model.
    pub fn plain(draw: &mut Draw) -> Self {
        Self { shape: Shape::Root, speed_rad_s: draw.log_uniform(0.03, 0.12) }
    }

    /// For the other half of the clean cases: a shape that the model does not have.
    pub fn foreign(draw: &mut Draw) -> Self {
        let shape = draw.choose(&[
            Shape::Tanh,
            Shape::Quartic,
            Shape::Hyperbola,
            Shape::Arctangent,
            Shape::RoundedStart,
        ]);
        Self { shape, speed_rad_s: draw.log_uniform(0.03, 0.12) }
    }

    /// The share of dry friction that acts at a speed (rad/s), with its sign.
    #[inline]
    pub fn share(&self, speed: f64) -> f64 {
        let x = speed / self.speed_rad_s;
        match self.shape {
            Shape::Root => x / (1.0 + x * x).sqrt(),
            Shape::Tanh => x.tanh(),
            Shape::Quartic => x / (1.0 + x.powi(4)).sqrt().sqrt(),
            Shape::Hyperbola => x / (1.0 + x.abs()),
            Shape::Arctangent => {
                (std::f64::consts::FRAC_PI_2 * x).atan() * std::f64::consts::FRAC_2_PI
            }
            Shape::RoundedStart => {
                x / (1.0 + x * x).sqrt() * (1.0 - 0.15 * (-0.25 * x.abs()).exp())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_are_odd_bounded_and_of_slope_one_at_most() {
        let shapes = [
            Shape::Root,
            Shape::Tanh,
            Shape::Quartic,
            Shape::Hyperbola,
            Shape::Arctangent,
            Shape::RoundedStart,
        ];
        for shape in shapes {
            let smoothing = Smoothing { shape, speed_rad_s: 0.1 };
            let mut last = 0.0;
            for index in 1..2000 {
                let speed = f64::from(index) * 0.002;
                let share = smoothing.share(speed);
                assert!(share <= 1.0 && share > last - 1e-12, "{shape:?} at {speed}: {share}");
                assert_eq!(share, -smoothing.share(-speed));
                assert!(share - last <= 0.02 + 1e-12, "{shape:?}");
                last = share;
            }
            assert!(smoothing.share(100.0) > 0.99, "{shape:?}");
        }
    }
}

//! How dry friction passes through zero speed.
//!
//! A simulator with ordinary steps cannot have friction that jumps; it has `F g(v/v_e)` with `g`
//! from -1 to 1. Nobody knows the shape of `g` in a real machine, so cases differ in it: half of
//! the clean ones have a shape that the model under test does not offer (its own is the root).

use serde::{Deserialize, Serialize};

use crate::draw::Draw;

/// Shape of the passage.
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
    /// `x/(1 + |x|)`: a long approach.
    Hyperbola,
    /// `(2/π) atan(π x/2)`: a longer one.
    Arctangent,
    /// `x/√(1 + x²)`, and the static value is reached only at some speed: friction starts rounded
    /// and without the full peak of the falling branch, `1 - 0.15 exp(-|x|/4)`.
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
    /// Of a case with an effect: the model's own shape or one near to it.
    pub fn common(draw: &mut Draw) -> Self {
        Self { shape: draw.choose(&[Shape::Root, Shape::Root, Shape::Tanh]), ..Self::plain(draw) }
    }

    /// Of a clean case of the plain half: the model's own shape.
    pub fn plain(draw: &mut Draw) -> Self {
        Self { shape: Shape::Root, speed_rad_s: draw.log_uniform(0.03, 0.12) }
    }

    /// Of the other half of the clean cases: a shape that the model does not have.
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
    fn odd_bounded_and_no_steeper_than_one() {
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

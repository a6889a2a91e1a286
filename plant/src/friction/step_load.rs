//! Loads on one degree of freedom during a step, and its motion.

/// How dry friction passes through zero speed where it is not exact: odd in the speed, 1 far out,
/// and of slope 1 over the speed at rest.
///
/// The shape is a free parameter of the model. With `x` for the speed over [`Smoothing::speed`],
/// shape 0 is `x/√(1 + x²)`, shape -1 the long approach `x/(1 + |x|)` and shape 1 the sharp corner
/// `x/(1 + x⁴)^¼`; between them it is a mixture of its neighbours.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Smoothing {
    /// Speed over which friction is spread (rad/s or m/s); 0 for exact stick.
    pub speed: f64,
    /// Shape, -1 to 1.
    pub shape: f64,
}

impl Smoothing {
    /// Share of dry friction that acts, its slope, and half the bend of it (positive where it bends
    /// down), at a ratio of speeds that is not negative.
    #[inline(always)]
    pub(super) fn share(&self, x: f64) -> (f64, f64, f64) {
        let root = 1.0 / (1.0 + x * x).sqrt();
        let cube = root * root * root;
        let middle = (x * root, cube, 1.5 * x * cube * root * root);
        if self.shape == 0.0 {
            return middle;
        }
        let other = if self.shape < 0.0 {
            let long = 1.0 / (1.0 + x);
            (x * long, long * long, long * long * long)
        } else {
            let square = x * x;
            let corner = 1.0 / (1.0 + square * square).sqrt().sqrt();
            let fifth = corner * (corner * corner) * (corner * corner);
            (x * corner, fifth, 2.5 * x * square * fifth * (corner * corner) * (corner * corner))
        };
        let part = self.shape.abs().min(1.0);
        let mix = |middle: f64, other: f64| middle + part * (other - middle);
        (mix(middle.0, other.0), mix(middle.1, other.1), mix(middle.2, other.2))
    }
}

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

/// Loads on one degree of freedom during a step.
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

/// Motion of one degree of freedom during a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Advance {
    /// Speed at the end.
    pub velocity: f64,
    /// Change of position.
    pub displacement: f64,
    /// Energy lost to dry and viscous friction, J.
    pub dissipated: f64,
}

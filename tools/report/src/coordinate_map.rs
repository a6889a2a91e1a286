//! From data coordinates to pixels, and clipping to the frame.

use crate::scale::Scale;

/// The frame of the data area in fine pixels, and the scale of each axis.
pub(crate) struct Axes {
    pub(crate) left: i32,
    pub(crate) right: i32,
    pub(crate) top: i32,
    pub(crate) bottom: i32,
    pub(crate) x: Scale,
    pub(crate) y: Scale,
}

impl Axes {
    /// Horizontal position of `x`.
    pub(crate) fn px(&self, x: f64) -> f64 {
        f64::from(self.left) + self.x.fraction(x) * f64::from(self.right - self.left)
    }

    /// Vertical position of `y`, counted downwards.
    pub(crate) fn py(&self, y: f64) -> f64 {
        f64::from(self.bottom) - self.y.fraction(y) * f64::from(self.bottom - self.top)
    }

    /// Whether a point lies in the frame or within one fine pixel of it.
    pub(crate) fn inside(&self, p: (f64, f64)) -> bool {
        p.0 >= f64::from(self.left) - 1.0
            && p.0 <= f64::from(self.right) + 1.0
            && p.1 >= f64::from(self.top) - 1.0
            && p.1 <= f64::from(self.bottom) + 1.0
    }

    /// The part of a line segment that lies in the frame (Liang and Barsky).
    pub(crate) fn clip(&self, a: (f64, f64), b: (f64, f64)) -> Option<((f64, f64), (f64, f64))> {
        let (dx, dy) = (b.0 - a.0, b.1 - a.1);
        let (mut from, mut to) = (0.0f64, 1.0f64);
        for (p, q) in [
            (-dx, a.0 - f64::from(self.left)),
            (dx, f64::from(self.right) - a.0),
            (-dy, a.1 - f64::from(self.top)),
            (dy, f64::from(self.bottom) - a.1),
        ] {
            if p == 0.0 {
                if q < 0.0 {
                    return None;
                }
            } else if p < 0.0 {
                from = from.max(q / p);
            } else {
                to = to.min(q / p);
            }
        }
        (from <= to).then_some(((a.0 + from * dx, a.1 + from * dy), (a.0 + to * dx, a.1 + to * dy)))
    }

    /// The series as polylines in fine pixels, clipped to the frame and interrupted where a value
    /// is not finite.
    pub(crate) fn runs(&self, xs: &[f64], ys: &[f64]) -> Vec<Vec<(i32, i32)>> {
        let mut runs: Vec<Vec<(i32, i32)>> = Vec::new();
        let mut before: Option<(f64, f64)> = None;
        let mut open = false;
        for (x, y) in xs.iter().zip(ys) {
            let p = (self.px(*x), self.py(*y));
            if !(p.0.is_finite() && p.1.is_finite()) {
                before = None;
                open = false;
                continue;
            }
            if let Some(a) = before {
                match self.clip(a, p) {
                    Some((from, to)) => {
                        if !open {
                            runs.push(vec![round(from)]);
                        }
                        if let Some(run) = runs.last_mut() {
                            run.push(round(to));
                        }
                        open = self.inside(p);
                    }
                    None => open = false,
                }
            }
            before = Some(p);
        }
        runs
    }
}

/// The nearest fine pixel.
pub(crate) fn round(p: (f64, f64)) -> (i32, i32) {
    (p.0.round() as i32, p.1.round() as i32)
}

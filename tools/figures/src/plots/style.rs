//! One size and one look for all: 420 CSS pixels with text of 13, which is 7.5 points when printed
//! 85 mm wide.

use report::{Colour, Figure};

/// Width of a panel, CSS pixels.
const WIDTH: u32 = 420;
/// Height of a panel, CSS pixels.
const HEIGHT: u32 = 290;

/// Empty axes of the common size.
pub(super) fn axes(title: &str, x: &str, y: &str) -> Figure {
    Figure::new(title, x, y).size(WIDTH, HEIGHT)
}

/// Taller axes, for many curves with a legend of several rows.
pub(super) fn tall(title: &str, x: &str, y: &str) -> Figure {
    Figure::new(title, x, y).size(WIDTH, HEIGHT + 50)
}

/// Axes for a gain over frequency.
pub(super) fn gain(title: &str) -> Figure {
    tall(title, "frequency / Hz", "gain, slave over master").log_x().log_y()
}

/// Axes for a phase over frequency.
pub(super) fn phase(title: &str) -> Figure {
    tall(title, "frequency / Hz", "phase / °").log_x()
}

/// One unnamed curve.
pub(super) fn curve(title: &str, x_label: &str, y_label: &str, x: &[f64], y: &[f64]) -> Figure {
    axes(title, x_label, y_label).line(Colour::Blue, "", x, y)
}

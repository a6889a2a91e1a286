//! Colour palette that readers with colour-vision deficiency can distinguish, also in greyscale.

use plotters::prelude::{ColorMap, ViridisRGB};
use plotters::style::RGBColor;

/// The palette of Okabe and Ito, "Color Universal Design" (2008).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Colour {
    /// By convention: measured data.
    Black,
    /// By convention: the model after a change, such as with effects.
    Blue,
    /// By convention: the model before a change, as declared.
    Vermillion,
    /// Bluish green.
    Green,
    /// Reddish purple.
    Purple,
    /// Orange.
    Orange,
    /// Sky blue.
    Sky,
    /// Neutral grey, for secondary curves.
    Grey,
    /// Position on the Viridis colour map, 0 (dark) to 255 (light), for a family of curves that a
    /// parameter orders.
    Ramp(u8),
}

/// Viridis without its yellow end, which is invisible on white.
const RAMP_END: f32 = 0.85;

impl Colour {
    /// Colour of curve `index` (from 0) of `count` curves on the ramp.
    pub fn ramp(index: usize, count: usize) -> Self {
        Self::Ramp((255 * index.min(count) / count.saturating_sub(1).max(1)).min(255) as u8)
    }

    pub(crate) fn rgb(self) -> RGBColor {
        match self {
            Self::Black => RGBColor(0x22, 0x22, 0x22),
            Self::Blue => RGBColor(0x00, 0x72, 0xB2),
            Self::Vermillion => RGBColor(0xD5, 0x5E, 0x00),
            Self::Green => RGBColor(0x00, 0x9E, 0x73),
            Self::Purple => RGBColor(0xCC, 0x79, 0xA7),
            Self::Orange => RGBColor(0xE6, 0x9F, 0x00),
            Self::Sky => RGBColor(0x56, 0xB4, 0xE9),
            Self::Grey => RGBColor(0x88, 0x88, 0x88),
            Self::Ramp(position) => ViridisRGB.get_color(RAMP_END * f32::from(position) / 255.0),
        }
    }
}

//! Colours that readers with any colour vision can tell apart, and in grey too.

use plotters::prelude::{ColorMap, ViridisRGB};
use plotters::style::RGBColor;

/// The palette of Okabe and Ito, "Color Universal Design" (2008).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Colour {
    /// Measured data, by habit.
    Black,
    /// First model curve, by habit the one after.
    Blue,
    /// Second model curve, by habit the one before.
    Vermillion,
    /// Bluish green.
    Green,
    /// Reddish purple.
    Purple,
    /// Orange.
    Orange,
    /// Sky blue.
    Sky,
    /// Neutral grey, for what stands in the background.
    Grey,
    /// A place along a ramp from dark to light, 0 to 255: for curves that belong to a growing
    /// quantity.
    Ramp(u8),
}

impl Colour {
    /// Colour of the `index`th of `count` curves along the ramp.
    pub fn ramp(index: usize, count: usize) -> Self {
        Self::Ramp((255 * index.min(count) / count.saturating_sub(1).max(1)).min(255) as u8)
    }

    /// The order in which series take colours when none is asked for.
    pub(crate) const ORDER: [Self; 7] = [
        Self::Blue,
        Self::Vermillion,
        Self::Green,
        Self::Purple,
        Self::Orange,
        Self::Sky,
        Self::Black,
    ];

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
            // Viridis, but for its yellow end, which white paper swallows.
            Self::Ramp(place) => ViridisRGB.get_color(0.85 * f32::from(place) / 255.0),
        }
    }
}

//! What a figure shows; `draw` knows how.

use crate::palette::Colour;
use crate::scale::Kind;

/// How one series is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Mark {
    Line,
    Dashed,
    Scatter,
    Band,
    Errors,
    HorizontalRule,
    VerticalRule,
}

#[derive(Clone, Debug)]
pub(crate) struct Series {
    pub(crate) name: String,
    pub(crate) mark: Mark,
    pub(crate) colour: Colour,
    pub(crate) x: Vec<f64>,
    /// The ordinate, or the lower edge of a band.
    pub(crate) y: Vec<f64>,
    /// The upper edge of a band, or the half length of error bars.
    pub(crate) upper: Vec<f64>,
}

/// One set of axes with its series. Values that are not finite break a line.
///
/// Labels carry the unit after a slash, as in `time / s`. A series with an empty name is drawn and
/// stays out of the legend.
#[derive(Clone, Debug)]
pub struct Figure {
    pub(crate) title: String,
    pub(crate) x_label: String,
    pub(crate) y_label: String,
    pub(crate) size: (u32, u32),
    pub(crate) x_kind: Kind,
    pub(crate) y_kind: Kind,
    pub(crate) x_range: Option<(f64, f64)>,
    pub(crate) y_range: Option<(f64, f64)>,
    pub(crate) series: Vec<Series>,
}

impl Figure {
    /// Empty axes, 680 by 340 CSS pixels: about one column and a half of a journal.
    pub fn new(
        title: impl Into<String>,
        x_label: impl Into<String>,
        y_label: impl Into<String>,
    ) -> Self {
        Self {
            title: title.into(),
            x_label: x_label.into(),
            y_label: y_label.into(),
            size: (680, 340),
            x_kind: Kind::Linear,
            y_kind: Kind::Linear,
            x_range: None,
            y_range: None,
            series: Vec::new(),
        }
    }

    /// Size in CSS pixels (fonts keep their size: 13 px).
    pub fn size(mut self, width: u32, height: u32) -> Self {
        self.size = (width.clamp(200, 4000), height.clamp(140, 4000));
        self
    }

    /// A logarithmic abscissa; values of 0 and below are left out.
    pub fn log_x(mut self) -> Self {
        self.x_kind = Kind::Logarithmic;
        self
    }

    /// An abscissa in seconds since 1970 that is labelled with dates (UTC).
    pub fn dates(mut self) -> Self {
        self.x_kind = Kind::Dates;
        self
    }

    /// A logarithmic ordinate; values of 0 and below are left out.
    pub fn log_y(mut self) -> Self {
        self.y_kind = Kind::Logarithmic;
        self
    }

    /// Fixes the range of the abscissa; what lies outside is cut off.
    pub fn x_range(mut self, low: f64, high: f64) -> Self {
        self.x_range = Some((low, high));
        self
    }

    /// Fixes the range of the ordinate; what lies outside is cut off.
    pub fn y_range(mut self, low: f64, high: f64) -> Self {
        self.y_range = Some((low, high));
        self
    }

    /// A full line; long ones are reduced to their envelope.
    pub fn line(self, colour: Colour, name: impl Into<String>, x: &[f64], y: &[f64]) -> Self {
        self.push((colour, name), Mark::Line, x, y, &[])
    }

    /// A dashed line, so that curves differ without colour too.
    pub fn dashed(self, colour: Colour, name: impl Into<String>, x: &[f64], y: &[f64]) -> Self {
        self.push((colour, name), Mark::Dashed, x, y, &[])
    }

    /// Points; thousands of them are thinned to what the eye can tell apart.
    pub fn scatter(self, colour: Colour, name: impl Into<String>, x: &[f64], y: &[f64]) -> Self {
        self.push((colour, name), Mark::Scatter, x, y, &[])
    }

    /// The area between `lower` and `upper`, shaded; broken, as lines are, where a value is not
    /// finite.
    pub fn band(
        self,
        colour: Colour,
        name: impl Into<String>,
        x: &[f64],
        lower: &[f64],
        upper: &[f64],
    ) -> Self {
        self.push((colour, name), Mark::Band, x, lower, upper)
    }

    /// Points with a bar of `half` above and below.
    pub fn errors(
        self,
        colour: Colour,
        name: impl Into<String>,
        x: &[f64],
        y: &[f64],
        half: &[f64],
    ) -> Self {
        self.push((colour, name), Mark::Errors, x, y, half)
    }

    /// A thin line across at one ordinate.
    pub fn horizontal(self, colour: Colour, name: impl Into<String>, at: f64) -> Self {
        self.push((colour, name), Mark::HorizontalRule, &[], &[at], &[])
    }

    /// A thin line upright at one abscissa.
    pub fn vertical(self, colour: Colour, name: impl Into<String>, at: f64) -> Self {
        self.push((colour, name), Mark::VerticalRule, &[at], &[], &[])
    }

    fn push(
        mut self,
        (colour, name): (Colour, impl Into<String>),
        mark: Mark,
        x: &[f64],
        y: &[f64],
        upper: &[f64],
    ) -> Self {
        let (name, x, y, upper) = (name.into(), x.to_vec(), y.to_vec(), upper.to_vec());
        self.series.push(Series { name, mark, colour, x, y, upper });
        self
    }
}

//! Figures and self-contained pages in one style.
//!
//! A [`Figure`] is drawn as one would print it in a journal: framed axes with units, ticks inside,
//! few grid lines, a palette that colour-blind readers can tell apart (Okabe and Ito 2008), long
//! series reduced to their envelope so that no peak is lost. A [`Page`] is one HTML file with
//! figures inlined as SVG: it needs no network and no other file, and prints on paper.
//!
//! ```
//! use report::{Colour, Figure, Page, Table, Tone};
//! let time: Vec<f64> = (0..5000).map(|i| i as f64 * 1e-3).collect();
//! let force: Vec<f64> = time.iter().map(|t| (6.28 * t).sin()).collect();
//! let figure = Figure::new("Force over one second", "time / s", "force / N")
//!     .line(Colour::Blue, "measured", &time, &force);
//! let page = Page::new("Drive")
//!     .verdict(Tone::Good, "Nothing is missing.", "The declared model explains the record.")
//!     .figure(&figure, "Fig. 1. Measured force.")
//!     .table(Table::new(["parameter", "value"]).row(["mass", "95.1 kg"]), "Fitted parameters.")
//!     .render()?;
//! assert!(page.contains("<svg") && !page.contains("src="));
//! # Ok::<(), report::Error>(())
//! ```
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used))]

mod coordinate_map;
mod decimate;
mod draw;
mod figure;
mod page;
mod palette;
mod panel_layout;
#[cfg(feature = "png")]
mod png;
mod scale;

pub use figure::Figure;
pub use page::{Page, Table, Tone};
pub use palette::Colour;
pub use panel_layout::Panels;
#[cfg(feature = "png")]
pub use png::PngRenderer;

/// Why a figure or page could not be made.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Two columns of one series differ in length.
    #[error(
        "figure `{figure}`, series `{series}`: {x} abscissae but {y} ordinates; pass columns of \
            one length"
    )]
    Lengths {
        /// Title of the figure.
        figure: String,
        /// Name of the series.
        series: String,
        /// Number of abscissae.
        x: usize,
        /// Number of ordinates.
        y: usize,
    },
    /// No finite point to draw (on a logarithmic axis: no positive one).
    #[error(
        "figure `{figure}`: no finite point in any series (on a logarithmic axis: no positive one)"
    )]
    Empty {
        /// Title of the figure.
        figure: String,
    },
    /// The drawing back end refused.
    #[error("figure `{figure}`: could not be drawn: {reason}")]
    Draw {
        /// Title of the figure.
        figure: String,
        /// What the back end said.
        reason: String,
    },
    /// There is no font on this machine to write a picture's text with.
    #[error(
        "no font found on this machine to write the pictures' text with; install one \
            (fonts-liberation)"
    )]
    Fonts,
    /// A row of a table has another number of cells than its header.
    #[error("table row `{row}`: {found} cells, the header has {expected}")]
    Row {
        /// First cell of the row.
        row: String,
        /// Cells in the header.
        expected: usize,
        /// Cells in the row.
        found: usize,
    },
    /// The page could not be written.
    #[error("{path}: cannot be written: {source}; choose a folder that you may write to")]
    Write {
        /// Where.
        path: String,
        /// What the operating system said.
        source: std::io::Error,
    },
}

/// What the functions of this crate return.
pub type Result<T> = std::result::Result<T, Error>;

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
//! # Ok::<(), anyhow::Error>(())
//! ```
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used))]

mod coordinate_map;
mod dates;
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

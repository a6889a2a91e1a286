//! Several axes as one picture.

use anyhow::Result;
use maud::{PreEscaped, html};

use crate::Figure;

/// Panels of one figure, laid out in rows and drawn as one SVG document.
#[derive(Clone, Debug)]
pub struct Panels {
    title: String,
    columns: usize,
    panels: Vec<Figure>,
}

impl Panels {
    /// An empty panels; the title is what a screen reader says.
    pub fn new(title: impl Into<String>) -> Self {
        Self { title: title.into(), columns: 1, panels: Vec::new() }
    }

    /// Panels beside one another; 1 (one under another) unless said otherwise.
    pub fn columns(mut self, columns: usize) -> Self {
        self.columns = columns.max(1);
        self
    }

    /// Adds a panel.
    pub fn panel(mut self, figure: Figure) -> Self {
        self.panels.push(figure);
        self
    }

    /// How many panels there are.
    pub fn count(&self) -> usize {
        self.panels.len()
    }

    /// Width and height, CSS pixels.
    pub fn size(&self) -> (u32, u32) {
        let width = self.panels.iter().map(|panel| panel.size.0).max().unwrap_or(0);
        let columns = self.columns.min(self.panels.len()) as u32;
        let height = self.panels.chunks(self.columns).map(row_height).sum();
        (width * columns, height)
    }

    /// All panels as a stand-alone SVG document.
    ///
    /// # Errors
    /// Those of [`Figure::render_svg`].
    pub fn render_svg(&self) -> Result<String> {
        let (width, height) = self.size();
        let cell = self.panels.iter().map(|panel| panel.size.0).max().unwrap_or(0);
        let mut panels = String::new();
        let mut top = 0;
        for row in self.panels.chunks(self.columns) {
            for (column, panel) in row.iter().enumerate() {
                let place = format!("<svg x=\"{}\" y=\"{top}\" ", column as u32 * cell);
                panels += &panel.render_svg()?.replacen("<svg ", &place, 1);
            }
            top += row_height(row);
        }
        let svg = html! {
            svg xmlns="http://www.w3.org/2000/svg" width=(width) height=(height)
                viewBox={ "0 0 " (width) " " (height) } style={ "max-width:" (width) "px" }
                role="img" aria-label=(self.title) {
                rect width=(width) height=(height) fill="#ffffff" {}
                (PreEscaped(panels))
            }
        };
        Ok(svg.into_string())
    }
}

fn row_height(row: &[Figure]) -> u32 {
    row.iter().map(|panel| panel.size.1).max().unwrap_or(0)
}

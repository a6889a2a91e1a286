//! From SVG to PNG.

use std::sync::Arc;

use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg::{Options, Tree, fontdb::Database};

use crate::{Error, Result};

/// Draws SVG documents with the fonts of this machine.
#[derive(Debug)]
pub struct PngRenderer(Arc<Database>);

impl PngRenderer {
    /// Loads the machine's fonts.
    ///
    /// # Errors
    /// [`Error::Fonts`] where it has none: a picture without its text would look like a result.
    pub fn new() -> Result<Self> {
        let mut fonts = Database::new();
        fonts.load_system_fonts();
        if fonts.is_empty() { Err(Error::Fonts) } else { Ok(Self(Arc::new(fonts))) }
    }

    /// The document as a PNG file, `width` pixels wide.
    ///
    /// # Errors
    /// [`Error::Draw`] for what is no SVG, or too large for memory.
    pub fn png(&self, name: &str, svg: &str, width: u32) -> Result<Vec<u8>> {
        let refused = |reason: String| Error::Draw { figure: name.to_owned(), reason };
        let options = Options { fontdb: Arc::clone(&self.0), ..Options::default() };
        let tree = Tree::from_str(svg, &options).map_err(|error| refused(error.to_string()))?;
        let scale = width as f32 / tree.size().width();
        let height = (tree.size().height() * scale).ceil() as u32;
        let mut pixels = Pixmap::new(width, height)
            .ok_or_else(|| refused(format!("{width} by {height} pixels are no picture")))?;
        resvg::render(&tree, Transform::from_scale(scale, scale), &mut pixels.as_mut());
        pixels.encode_png().map_err(|error| refused(error.to_string()))
    }
}

//! From SVG to PNG.

use std::sync::Arc;

use anyhow::{Context as _, Result, bail};
use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg::{Options, Tree, fontdb::Database};

/// Draws SVG documents with the fonts of this machine.
#[derive(Debug)]
pub struct PngRenderer(Arc<Database>);

impl PngRenderer {
    /// Loads the machine's fonts.
    ///
    /// # Errors
    /// Where it has none: a picture without its text would look like a result.
    pub fn new() -> Result<Self> {
        let mut fonts = Database::new();
        fonts.load_system_fonts();
        if fonts.is_empty() {
            bail!(
                "no font found on this machine to write the pictures' text with; install one \
                    (fonts-liberation)"
            );
        }
        Ok(Self(Arc::new(fonts)))
    }

    /// The document as a PNG file, `width` pixels wide.
    ///
    /// # Errors
    /// For what is no SVG, or too large for memory.
    pub fn png(&self, name: &str, svg: &str, width: u32) -> Result<Vec<u8>> {
        let refused = || format!("figure `{name}`: could not be drawn");
        let options = Options { fontdb: Arc::clone(&self.0), ..Options::default() };
        let tree = Tree::from_str(svg, &options).with_context(refused)?;
        let scale = width as f32 / tree.size().width();
        let height = (tree.size().height() * scale).ceil() as u32;
        let mut pixels = Pixmap::new(width, height)
            .with_context(|| format!("{}: {width} by {height} pixels are no picture", refused()))?;
        resvg::render(&tree, Transform::from_scale(scale, scale), &mut pixels.as_mut());
        pixels.encode_png().with_context(refused)
    }
}

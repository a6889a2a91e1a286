//! One HTML file: no network, no script, no second file.

use std::path::Path;

use anyhow::{Context as _, Error, Result, bail};
use maud::{DOCTYPE, Markup, PreEscaped, html};

use crate::{Figure, Panels};

/// Colour of a verdict.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tone {
    /// A result that asks for nothing.
    Neutral,
    /// All is well.
    Good,
    /// Somebody should look.
    Warning,
    /// Something is wrong.
    Bad,
}

impl Tone {
    const fn class(self) -> &'static str {
        match self {
            Self::Neutral => "neutral",
            Self::Good => "good",
            Self::Warning => "warning",
            Self::Bad => "bad",
        }
    }
}

/// Rows under a header; columns that hold only numbers are set flush right.
#[derive(Clone, Debug, Default)]
pub struct Table {
    header: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl Table {
    /// A table with its header.
    pub fn new<T: Into<String>>(header: impl IntoIterator<Item = T>) -> Self {
        Self { header: header.into_iter().map(Into::into).collect(), rows: Vec::new() }
    }

    /// Adds a row; it must have as many cells as the header.
    pub fn row<T: Into<String>>(mut self, cells: impl IntoIterator<Item = T>) -> Self {
        self.rows.push(cells.into_iter().map(Into::into).collect());
        self
    }

    /// Adds rows, each as [`Table::row`] does.
    pub fn rows<R: IntoIterator<Item: Into<String>>>(
        self,
        rows: impl IntoIterator<Item = R>,
    ) -> Self {
        rows.into_iter().fold(self, Self::row)
    }

    fn html(&self, caption: &str) -> Result<Markup> {
        let expected = self.header.len();
        if let Some(row) = self.rows.iter().find(|row| row.len() != expected) {
            let first = row.first().map_or("", String::as_str);
            bail!("table row `{first}`: {} cells, the header has {expected}", row.len());
        }
        let number: Vec<bool> =
            (0..self.header.len()).map(|c| self.rows.iter().all(|r| is_number(&r[c]))).collect();
        // The caption keeps the text's width, however wide the table is.
        Ok(html! {
            figure.table {
                @if !caption.is_empty() { figcaption { (caption) } }
                div.wide { table {
                    thead { tr {
                        @for (cell, number) in self.header.iter().zip(&number) {
                            th scope="col" class=[number.then_some("number")] { (cell) }
                        }
                    } }
                    tbody {
                        @for row in &self.rows {
                            tr {
                                @for (cell, number) in row.iter().zip(&number) {
                                    td class=[number.then_some("number")] { (cell) }
                                }
                            }
                        }
                    }
                } }
            }
        })
    }
}

/// Whether a cell reads as a number: digits, signs, `±`, a percent sign, or a dash for "none".
fn is_number(cell: &str) -> bool {
    let cell = cell.trim();
    cell == "–"
        || cell.chars().any(|c| c.is_ascii_digit())
            && cell.chars().all(|c| c.is_ascii_digit() || "+-−±.,·eE% ×⁻⁰¹²³⁴⁵⁶⁷⁸⁹".contains(c))
}

/// A page under construction; an error in one part is reported by [`Page::render`] or
/// [`Page::write`].
#[derive(Debug)]
pub struct Page {
    title: String,
    body: String,
    footer: String,
    error: Option<Error>,
}

impl Page {
    /// An empty page with its heading.
    pub fn new(title: impl Into<String>) -> Self {
        Self { title: title.into(), body: String::new(), footer: String::new(), error: None }
    }

    /// Adds a part, on a line of its own.
    fn add(mut self, part: Markup) -> Self {
        self.body.push_str(&part.into_string());
        self.body.push('\n');
        self
    }

    /// Adds a part; keeps the first error instead.
    fn try_add(mut self, part: Result<Markup>) -> Self {
        match part {
            Ok(part) => self.add(part),
            Err(error) => {
                self.error.get_or_insert(error);
                self
            }
        }
    }

    /// A quiet line, such as what was measured, when, with what.
    pub fn subtitle(self, text: &str) -> Self {
        self.add(html! { p.subtitle { (text) } })
    }

    /// A banner with one sentence that says it all, and a second that says how far it holds.
    pub fn verdict(self, tone: Tone, sentence: &str, detail: &str) -> Self {
        self.add(html! { div.verdict.(tone.class()) { strong { (sentence) } (detail) } })
    }

    /// A section's heading.
    pub fn heading(self, text: &str) -> Self {
        self.add(html! { h2 { (text) } })
    }

    /// Plain text.
    pub fn paragraph(self, text: &str) -> Self {
        self.add(html! { p { (text) } })
    }

    /// A figure with its caption.
    pub fn figure(self, figure: &Figure, caption: &str) -> Self {
        self.drawing(figure.render_svg(), caption)
    }

    /// A figure of several panels with its caption, no larger than it was drawn.
    pub fn panels(self, panels: &Panels, caption: &str) -> Self {
        self.drawing(panels.render_svg(), caption)
    }

    /// A picture, as an SVG document, with its caption.
    pub fn picture(self, svg: String, caption: &str) -> Self {
        self.drawing(Ok(svg), caption)
    }

    fn drawing(self, svg: Result<String>, caption: &str) -> Self {
        let figure =
            |svg| html! { figure { (PreEscaped::<String>(svg)) figcaption { (caption) } } };
        self.try_add(svg.map(figure))
    }

    /// A table with its caption.
    pub fn table(self, table: Table, caption: &str) -> Self {
        self.try_add(table.html(caption))
    }

    /// Another page without its title and footer, which the reader may open.
    pub fn folded(mut self, summary: &str, other: &Self) -> Self {
        if let (None, Some(error)) = (&self.error, &other.error) {
            self.error = Some(anyhow::anyhow!("{error:#}"));
        }
        self.add(html! { details { summary { (summary) } (PreEscaped(&other.body)) } })
    }

    /// Text that the reader may open, set in a fixed width (a JSON document, a log).
    pub fn details(self, summary: &str, text: &str) -> Self {
        self.add(html! { details { summary { (summary) } pre { (text) } } })
    }

    /// Where the page comes from: program, version, revision.
    pub fn footer(mut self, text: &str) -> Self {
        self.footer = text.to_owned();
        self
    }

    /// The page as text.
    ///
    /// # Errors
    /// The first error of a figure or table that was added.
    pub fn render(self) -> Result<String> {
        if let Some(error) = self.error {
            return Err(error);
        }
        let has_figure = self.body.contains("data-frame=");
        let page = html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    meta name="viewport" content="width=device-width, initial-scale=1";
                    title { (self.title) }
                    style { (PreEscaped(include_str!("style.css"))) }
                }
                body { main {
                    h1 { (self.title) }
                    (PreEscaped(self.body))
                    @if !self.footer.is_empty() { footer { (self.footer) } }
                }
                @if has_figure { script { (PreEscaped(include_str!("hover.js"))) } }
                }
            }
        };
        Ok(page.into_string() + "\n")
    }

    /// Writes the page, and its folder where that is missing.
    ///
    /// # Errors
    /// As [`Page::render`], and where the file cannot be written.
    pub fn write(self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        let html = self.render()?;
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        let made = folder.map_or(Ok(()), std::fs::create_dir_all);
        made.and_then(|()| std::fs::write(path, html)).with_context(|| {
            format!("{}: cannot be written; choose a folder that you may write to", path.display())
        })
    }
}

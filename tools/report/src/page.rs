//! One HTML file: no network, no script, no second file.

use std::fmt::Write as _;
use std::path::Path;

use crate::escape::escape;
use crate::{Error, Figure, Panels, Result};

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

    fn html(&self, caption: &str) -> Result<String> {
        if let Some(row) = self.rows.iter().find(|r| r.len() != self.header.len()) {
            let first = row.first().cloned().unwrap_or_default();
            return Err(Error::Row { row: first, expected: self.header.len(), found: row.len() });
        }
        let numeric: Vec<bool> =
            (0..self.header.len()).map(|c| self.rows.iter().all(|r| is_number(&r[c]))).collect();
        let class = |c: usize| if numeric[c] { " class=\"number\"" } else { "" };
        // The caption keeps the text's width, however wide the table is.
        let mut out = String::from("<figure class=\"table\">");
        if !caption.is_empty() {
            let _ = write!(out, "<figcaption>{}</figcaption>", escape(caption));
        }
        out.push_str("<div class=\"wide\"><table><thead><tr>");
        for (c, cell) in self.header.iter().enumerate() {
            let _ = write!(out, "<th scope=\"col\"{}>{}</th>", class(c), escape(cell));
        }
        out.push_str("</tr></thead><tbody>");
        for row in &self.rows {
            out.push_str("<tr>");
            for (c, cell) in row.iter().enumerate() {
                let _ = write!(out, "<td{}>{}</td>", class(c), escape(cell));
            }
            out.push_str("</tr>\n");
        }
        out.push_str("</tbody></table></div></figure>\n");
        Ok(out)
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

    /// A quiet line, such as what was measured, when, with what.
    pub fn subtitle(mut self, text: &str) -> Self {
        let _ = writeln!(self.body, "<p class=\"subtitle\">{}</p>", escape(text));
        self
    }

    /// A banner with one sentence that says it all, and a second that says how far it holds.
    pub fn verdict(mut self, tone: Tone, sentence: &str, detail: &str) -> Self {
        let class = tone.class();
        let _ = write!(
            self.body,
            "<div class=\"verdict {class}\"><strong>{}</strong>",
            escape(sentence)
        );
        let _ = writeln!(self.body, "{}</div>", escape(detail));
        self
    }

    /// A section's heading.
    pub fn heading(mut self, text: &str) -> Self {
        let _ = writeln!(self.body, "<h2>{}</h2>", escape(text));
        self
    }

    /// Plain text.
    pub fn paragraph(mut self, text: &str) -> Self {
        let _ = writeln!(self.body, "<p>{}</p>", escape(text));
        self
    }

    /// A figure with its caption.
    pub fn figure(mut self, figure: &Figure, caption: &str) -> Self {
        match figure.render_svg() {
            Ok(svg) => {
                let _ = writeln!(
                    self.body,
                    "<figure>{svg}<figcaption>{}</figcaption></figure>",
                    escape(caption)
                );
            }
            Err(error) => self.error = self.error.or(Some(error)),
        }
        self
    }

    /// A figure of several panels with its caption, no larger than it was drawn.
    pub fn panels(mut self, panels: &Panels, caption: &str) -> Self {
        match panels.render_svg() {
            Ok(svg) => {
                let _ = writeln!(
                    self.body,
                    "<figure>{svg}<figcaption>{}</figcaption></figure>",
                    escape(caption)
                );
            }
            Err(error) => self.error = self.error.or(Some(error)),
        }
        self
    }

    /// A table with its caption.
    pub fn table(mut self, table: Table, caption: &str) -> Self {
        match table.html(caption) {
            Ok(html) => self.body.push_str(&html),
            Err(error) => self.error = self.error.or(Some(error)),
        }
        self
    }

    /// Text that the reader may open, set in a fixed width (a JSON document, a log).
    pub fn details(mut self, summary: &str, text: &str) -> Self {
        let (summary, text) = (escape(summary), escape(text));
        let _ =
            writeln!(self.body, "<details><summary>{summary}</summary><pre>{text}</pre></details>");
        self
    }

    /// Where the page comes from: program, version, revision.
    pub fn footer(mut self, text: &str) -> Self {
        self.footer = format!("<footer>{}</footer>\n", escape(text));
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
        Ok(format!(
            "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <title>{title}</title>\n<style>\n{css}</style></head>\n<body><main>\n\
             <h1>{title}</h1>\n{body}{footer}</main></body></html>\n",
            title = escape(&self.title),
            css = include_str!("style.css"),
            body = self.body,
            footer = self.footer,
        ))
    }

    /// Writes the page, and its folder where that is missing.
    ///
    /// # Errors
    /// As [`Page::render`], and [`Error::Write`].
    pub fn write(self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        let html = self.render()?;
        let wrap = |source| Error::Write { path: path.display().to_string(), source };
        if let Some(folder) = path.parent().filter(|f| !f.as_os_str().is_empty()) {
            std::fs::create_dir_all(folder).map_err(wrap)?;
        }
        std::fs::write(path, html).map_err(wrap)
    }
}

//! Progress of the run: lines on standard output and, on a terminal, a status line
//! below them.

use std::io::{IsTerminal as _, Write as _};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

/// Output to a terminal or a pipe.
#[derive(Debug)]
pub(crate) struct Terminal {
    /// The status line; hidden in a pipe.
    bar: ProgressBar,
}

impl Terminal {
    pub(crate) fn new() -> Self {
        if !(std::io::stdout().is_terminal() && std::io::stderr().is_terminal()) {
            return Self { bar: ProgressBar::hidden() };
        }
        let bar = ProgressBar::new_spinner();
        if let Ok(style) = ProgressStyle::with_template("{spinner} {wide_msg}") {
            bar.set_style(style);
        }
        bar.enable_steady_tick(Duration::from_millis(100));
        Self { bar }
    }

    /// Prints a line on standard output.
    pub(crate) fn print(&self, text: &str) {
        self.bar.suspend(|| {
            // A closed pipe must not end the run.
            let _closed = writeln!(std::io::stdout(), "{text}");
        });
    }

    /// Prints a warning on standard error.
    pub(crate) fn warn(&self, text: &str) {
        self.bar.suspend(|| eprintln!("{text}"));
    }

    /// Shows the current activity on the status line; does nothing in a pipe.
    pub(crate) fn progress(&self, text: impl Into<String>) {
        self.bar.set_message(text.into());
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

//! How far a command is that reads whole recordings: a bar on stderr, where that is a terminal.

use indicatif::{ProgressBar, ProgressStyle};
use recording::mcap_read::{Recording, Selection};

/// A bar that is there until this is dropped.
pub(crate) struct Progress(ProgressBar);

impl Progress {
    /// Shows how much is read of what is selected in recordings, `passes` times; nothing where
    /// stderr is no terminal, or the output is JSON.
    pub(crate) fn of<'a>(
        recordings: impl IntoIterator<Item = &'a Recording>,
        selection: &Selection,
        passes: usize,
        json: bool,
    ) -> Self {
        let bar = if json { ProgressBar::hidden() } else { ProgressBar::new(0) };
        let template = "{wide_bar} {bytes} of {total_bytes}, {elapsed}, {eta} left";
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style);
        }
        for recording in recordings {
            bar.inc_length(recording.selected_bytes(selection) * passes as u64);
            let bar = bar.clone();
            recording.watch(move |bytes| bar.inc(bytes));
        }
        Self(bar)
    }

    /// Prints to the terminal beside the bar.
    pub(crate) fn beside<T>(&self, print: impl FnOnce() -> T) -> T {
        self.0.suspend(print)
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}

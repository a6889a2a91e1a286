//! Prints `status`, once or repeatedly.

use std::io::{IsTerminal, Write};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant, SystemTime};

use runtime::RigName;
use signal_hook::consts::{SIGINT, SIGTERM};

use crate::status::{RigStatus, Watcher, table};
use crate::{DONE, FAILED};

/// Period of `--watch`.
const PERIOD: Duration = Duration::from_secs(1);

pub(super) fn status(rig_name: &RigName, watch: bool, as_json: bool) -> anyhow::Result<i32> {
    let mut watcher = Watcher::default();
    let mut out = std::io::stdout();
    if !watch {
        let status = watcher.status(rig_name)?;
        write!(out, "{}", shown(&status, as_json, false)?)?;
        return Ok(if status.up { DONE } else { FAILED });
    }
    let stop = runtime::stop_on(&[SIGINT, SIGTERM])?;
    let redraw = out.is_terminal() && !as_json;
    loop {
        let begun = Instant::now();
        let status = watcher.status(rig_name)?;
        let text = shown(&status, as_json, true)?;
        if redraw {
            // Redraws from the top left and erases what is left of the old text: no flicker.
            write!(out, "\x1b[H{}\x1b[J", text.replace('\n', "\x1b[K\n"))?;
        } else {
            write!(out, "{text}")?;
        }
        out.flush()?;
        while begun.elapsed() < PERIOD && !stop.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(20));
        }
        if stop.load(Ordering::Relaxed) {
            return Ok(DONE);
        }
    }
}

fn shown(status: &RigStatus, as_json: bool, in_one_line: bool) -> anyhow::Result<String> {
    Ok(match (as_json, in_one_line) {
        (true, true) => format!("{}\n", serde_json::to_string(status)?),
        (true, false) => format!("{}\n", serde_json::to_string_pretty(status)?),
        (false, _) => table(status, SystemTime::now(), width()),
    })
}

/// Columns of the terminal; unlimited in a pipe.
fn width() -> usize {
    let terminal = || terminal_size::terminal_size().map_or(80, |(width, _)| width.0.into());
    if std::io::stdout().is_terminal() { terminal() } else { usize::MAX }
}

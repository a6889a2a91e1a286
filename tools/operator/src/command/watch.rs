//! `status`.

use std::io::{IsTerminal, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime};

use runtime::RigName;

use crate::status::{RigStatus, Watcher, table};
use crate::{DONE, FAILED};

/// How often `--watch` shows it.
const EVERY: Duration = Duration::from_secs(1);

pub(super) fn status(rig_name: &RigName, watch: bool, as_json: bool) -> anyhow::Result<i32> {
    let mut watcher = Watcher::default();
    let mut out = std::io::stdout();
    if !watch {
        let status = watcher.look(rig_name)?;
        write!(out, "{}", shown(&status, as_json, false)?)?;
        return Ok(if status.up { DONE } else { FAILED });
    }
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&stop))?;
    }
    let redraw = out.is_terminal() && !as_json;
    loop {
        let begun = Instant::now();
        let status = watcher.look(rig_name)?;
        let text = shown(&status, as_json, true)?;
        if redraw {
            // from the top left, each line's rest and what is below wiped: no flicker
            write!(out, "\x1b[H{}\x1b[J", text.replace('\n', "\x1b[K\n"))?;
        } else {
            write!(out, "{text}")?;
        }
        out.flush()?;
        while begun.elapsed() < EVERY && !stop.load(Ordering::Relaxed) {
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
        (false, _) => table(status, SystemTime::now()),
    })
}

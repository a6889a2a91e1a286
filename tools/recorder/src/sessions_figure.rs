//! The figure of `sessions`: what the subject had to match, and what it did.

use anyhow::bail;
use ipc_types::{BARS, Performance};
use recording::mcap_read::Recording;
use report::{Colour, Figure};

use crate::ended_sessions::{EndedSession, bar_updates};

/// Colour and name of each bar, where there are two.
const BAR: [(Colour, &str); BARS] =
    [(Colour::Green, "agonists"), (Colour::Vermillion, "antagonists")];

/// The bars' values at each update, and the targets, over the time since the first session began.
///
/// # Errors
/// Those of reading, and where the sessions have no bar.
pub(crate) fn figure(recording: &Recording, sessions: &[EndedSession]) -> anyhow::Result<Figure> {
    let bars = sessions.iter().map(|session| usize::from(session.result.bars)).max().unwrap_or(0);
    let bars = bars.min(BARS);
    if bars == 0 {
        bail!("--figure: these sessions match nothing, and have no bar to draw");
    }
    let what = if bars == 2 { "muscle activity" } else { "mean torque so far" };
    let mut figure = Figure::new("Sessions", "time since the first began / s", what).size(900, 320);
    let began_ns = sessions.first().map_or(0, |session| session.result.begun_ns);
    let seconds = |at_ns: u64| (at_ns as f64 - began_ns as f64) * 1e-9;
    let updates = bar_updates(recording)?;
    for (at, session) in sessions.iter().enumerate() {
        let result = &session.result;
        for (bar, (colour, group)) in BAR.into_iter().enumerate().take(bars) {
            // Each curve has one entry in the legend.
            let name = |what: &str| match (at, bars) {
                (0, 2) => format!("{group}, {what}"),
                (0, _) => what.to_owned(),
                _ => String::new(),
            };
            let of = |shown: &&Performance| shown.begun_ns == result.begun_ns;
            let (x, y): (Vec<f64>, Vec<f64>) = updates
                .iter()
                .filter(of)
                .map(|shown| (seconds(shown.at_ns), shown.value[bar]))
                .unzip();
            figure = figure.line(colour, name("value"), &x, &y);
            if result.number > 1 {
                let ends = [seconds(result.begun_ns), seconds(result.ended_ns)];
                let name = if at == 1 && bars == 1 { "target" } else { "" };
                figure = figure.dashed(colour, name, &ends, &[result.target[bar]; 2]);
            }
        }
    }
    Ok(figure)
}

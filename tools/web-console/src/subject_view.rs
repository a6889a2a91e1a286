//! What the subject sees: bars, light, a line of instruction.

use std::borrow::Cow;

use ipc_types::{BAR_MIDDLE, BARS, Light, Mode, Performance};
use serde::Serialize;

/// A bar that is older is not shown: the topic has 50 messages a second while a protocol with
/// sessions runs (ns).
const STALE_NS: u64 = 500_000_000;
/// Height of a full bar; its middle is the target.
pub(crate) const FULL: f64 = 2.0 * BAR_MIDDLE;

/// What the subject sees at an instant.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub(crate) struct SubjectView {
    /// Instant of what the bars show (ms, `CLOCK_MONOTONIC`); 0 where nothing is shown.
    pub(crate) at_ms: f64,
    /// `green`, `red`; nothing where no protocol with sessions runs.
    pub(crate) light: Option<&'static str>,
    /// The bars: none, the effort's, or agonist's and antagonist's.
    pub(crate) bars: Vec<Bar>,
    /// Whether the bars repeat the last session.
    pub(crate) replay: bool,
    /// Number of the session that runs or ran last, from 1; 0 before the first.
    pub(crate) session: u32,
    /// Number of sessions.
    pub(crate) sessions: u32,
    /// Updates of the bar since the session, or the rest, began.
    pub(crate) update: u32,
    /// What the subject is told.
    pub(crate) instruction: Cow<'static, str>,
}

/// A bar.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Bar {
    /// What it stands for.
    pub(crate) label: &'static str,
    /// Height, 0 to 1; the target is at 0.5.
    pub(crate) height: f64,
    /// What it shows: mean torque (N·m or N), or activity.
    pub(crate) value: f64,
    /// What its middle stands for; 0 where there is no target yet.
    pub(crate) target: f64,
}

impl SubjectView {
    /// From the newest message of topic `performance`, the mode of control, and whether a protocol
    /// runs; what the protocol `told` the subject takes the place of the usual instruction.
    pub(crate) fn new(
        performance: Option<&Performance>,
        mode: Option<Mode>,
        running: bool,
        told: Option<&str>,
        now_ns: u64,
    ) -> Self {
        let told = told.filter(|_| running).map(|told| Cow::Owned(told.to_owned()));
        let fresh =
            performance.filter(|shown| running && now_ns.saturating_sub(shown.time_ns) < STALE_NS);
        let Some(shown) = fresh else {
            return Self {
                instruction: told.unwrap_or(instruction(mode, None, false, running)),
                ..Self::default()
            };
        };
        let light = Light::from_code(shown.light).unwrap_or(Light::Red);
        let count = usize::from(shown.bars).min(BARS);
        let labels: &[&str] = if count > 1 { &["agonist", "antagonist"] } else { &["effort"] };
        let bar = |(at, label): (usize, &&'static str)| Bar {
            label,
            height: (shown.height[at] / FULL).clamp(0.0, 1.0),
            value: shown.value[at],
            target: shown.target[at],
        };
        Self {
            at_ms: shown.at_ns as f64 / 1e6,
            light: Some(light.text()),
            bars: labels.iter().take(count).enumerate().map(bar).collect(),
            replay: shown.replay != 0,
            session: shown.number,
            sessions: shown.sessions,
            update: shown.update,
            instruction: told.unwrap_or(instruction(mode, Some(light), count > 0, running)),
        }
    }
}

/// The line of instruction.
fn instruction(
    mode: Option<Mode>,
    light: Option<Light>,
    has_bar: bool,
    running: bool,
) -> Cow<'static, str> {
    Cow::Borrowed(match (mode, light) {
        _ if !running => "",
        (Some(Mode::Initialise), _) => "The machine looks for its stops. Please do not resist.",
        (Some(Mode::Centre), _) => "The handle goes to the centre. Please do not resist.",
        (Some(Mode::Rhythm), Some(Light::Green)) if has_bar => {
            "Move the handle to and fro. Keep the bar at the line."
        }
        (Some(Mode::Rhythm), Some(Light::Green)) => "Move the handle to and fro.",
        (_, Some(Light::Green)) if has_bar => "Keep the bar at the line.",
        (_, Some(Light::Green)) => "Please go on.",
        (_, Some(Light::Red)) => "No force, please. Wait for the green light.",
        (_, None) => "",
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn performance(bars: u8) -> Performance {
        Performance {
            time_ns: 2_000_000_000,
            at_ns: 1_980_000_000,
            height: [10.0, 19.0],
            value: [0.2, 0.4],
            target: [0.2, 0.1],
            number: 2,
            sessions: 4,
            update: 3,
            bars,
            light: Light::Green.code(),
            ..Performance::default()
        }
    }

    #[test]
    fn the_target_is_in_the_middle() {
        let shown = performance(1);
        let view = SubjectView::new(Some(&shown), Some(Mode::Position), true, None, 2_010_000_000);
        assert_eq!(view.bars.len(), 1);
        assert_eq!((view.bars[0].label, view.bars[0].height), ("effort", 0.5));
        assert_eq!((view.light, view.at_ms), (Some("green"), 1980.0));
        let view = SubjectView::new(Some(&performance(2)), None, true, None, 2_010_000_000);
        let labels: Vec<_> = view.bars.iter().map(|bar| bar.label).collect();
        assert_eq!(labels, ["agonist", "antagonist"]);
        assert_eq!(view.bars[1].height, 0.95);
        assert!(
            SubjectView::new(Some(&performance(0)), None, true, None, 2_010_000_000)
                .bars
                .is_empty()
        );
    }

    #[test]
    fn an_old_bar_and_that_of_a_protocol_that_has_ended_are_not_shown() {
        let shown = performance(1);
        for (running, now_ns) in [(true, 2_600_000_000), (false, 2_010_000_000)] {
            let view = SubjectView::new(Some(&shown), Some(Mode::Rhythm), running, None, now_ns);
            assert!(view.bars.is_empty() && view.light.is_none(), "{view:?}");
        }
    }

    #[test]
    fn what_the_protocol_says_takes_the_place_of_the_usual() {
        let shown = performance(1);
        let told = Some("Squeeze as hard as you can.");
        let view = SubjectView::new(Some(&shown), Some(Mode::Hold), true, told, 2_010_000_000);
        assert_eq!(view.instruction, "Squeeze as hard as you can.");
        let view = SubjectView::new(None, Some(Mode::Hold), true, told, 2_010_000_000);
        assert_eq!(view.instruction, "Squeeze as hard as you can.");
        let view = SubjectView::new(None, None, false, told, 2_010_000_000);
        assert_eq!(view.instruction, "", "the protocol is over");
    }

    #[test]
    fn red_means_no_force() {
        let red = Performance { light: Light::Red.code(), ..performance(0) };
        let view = SubjectView::new(Some(&red), Some(Mode::Passive), true, None, 2_010_000_000);
        assert!(view.instruction.contains("No force"));
        let view = SubjectView::new(Some(&red), Some(Mode::Centre), true, None, 2_010_000_000);
        assert!(view.instruction.contains("do not resist"));
    }
}

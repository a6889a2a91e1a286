//! The model beside the machine, on the screen of `top`.

use ipc_types::{
    AXES, Event, Innovation, MODEL_DEPARTURE_SUM, Message, ModelSite, ModelState, ModelStatus,
    MonitorState, NewestModel, Process, Topic,
};

/// Cells of the bar that a cumulative sum at its threshold fills.
const BAR: usize = 10;

/// Squares of the innovations of one axis.
#[derive(Clone, Copy, Debug, Default)]
struct Squares {
    rows: u64,
    /// Of master and slave (rad²).
    sums: [f64; 2],
    slave_present: bool,
}

/// What the monitor published of the axes.
#[derive(Default)]
pub(crate) struct ModelRows {
    newest: NewestModel,
    squares: [Squares; AXES],
}

impl ModelRows {
    /// Takes a message of any topic; those of other processes change nothing.
    pub(crate) fn observe(&mut self, topic: &Topic, bytes: &[u8]) {
        match topic.type_name {
            ModelState::TYPE_NAME => {
                if let Some(state) = ModelState::from_bytes(bytes) {
                    self.newest.see_state(&state);
                }
            }
            Innovation::TYPE_NAME => {
                let row = Innovation::from_bytes(bytes);
                if let Some(row) = row
                    && let Some(own) = self.squares.get_mut(usize::from(row.axis))
                {
                    own.rows += 1;
                    own.sums[0] += row.master.powi(2);
                    own.sums[1] += row.slave.powi(2);
                    own.slave_present = row.slave_present == 1;
                }
            }
            Event::TYPE_NAME => {
                let event = Event::from_bytes(bytes);
                let told = event.filter(|event| event.source == Process::Monitor.code());
                if let Some(event) = told {
                    self.newest.see_event(&event);
                }
            }
            _ => {}
        }
    }

    /// Begins a new screen.
    pub(crate) fn reset(&mut self) {
        self.squares = Default::default();
    }

    /// A table with a row for each axis, and a sentence for what a row does not tell; empty without
    /// the monitor. Ticks come at `rate_hz`, if that is known.
    pub(crate) fn render(&self, rate_hz: Option<f64>, now_ns: u64) -> (Vec<String>, Vec<String>) {
        let axes = self.newest.status(rate_hz, now_ns);
        if axes.is_empty() {
            return Default::default();
        }
        let head = format!(
            "{:<7} {:<14} {:>20} {:>8}  {:<16}  place",
            "model",
            "state",
            "innovation °: master",
            "slave",
            format!("sum, of {MODEL_DEPARTURE_SUM}")
        );
        let rows = axes.iter().map(|axis| self.row(axis));
        let table = std::iter::once(head).chain(rows).collect();
        let needs_words = |axis: &&ModelStatus| {
            axis.is_departed() || axis.state == MonitorState::Blind || axis.silent_s.is_some()
        };
        (table, axes.iter().filter(needs_words).map(ModelStatus::sentence).collect())
    }

    fn row(&self, axis: &ModelStatus) -> String {
        let own = self.squares.get(axis.axis).copied().unwrap_or_default();
        let rms = |side: usize| match own.rows > 0 && (side == 0 || own.slave_present) {
            true => format!("{:.4}", (own.sums[side] / own.rows as f64).sqrt().to_degrees()),
            false => "-".to_owned(),
        };
        let state = match axis.state {
            MonitorState::Learning => format!("{} {:.0} %", axis.word(), 100.0 * axis.learnt),
            _ => axis.word().to_owned(),
        };
        let (bar, sum) = axis.sum.map_or_else(
            || (String::new(), "-".to_owned()),
            |sum| (bar(sum / MODEL_DEPARTURE_SUM), format!("{sum:.1}")),
        );
        let place = axis.site.map_or("", ModelSite::text);
        format!(
            "{:<7} {state:<14} {:>20} {:>8}  {bar:<BAR$} {sum:>5}  {place}",
            format!("axis {}", axis.axis),
            rms(0),
            rms(1),
        )
    }
}

/// A bar for a share of its length; full from 1 on.
fn bar(share: f64) -> String {
    let filled = (share.clamp(0.0, 1.0) * BAR as f64).round() as usize;
    "█".repeat(filled) + &"░".repeat(BAR - filled)
}

#[cfg(test)]
mod tests {
    use ipc_types::{EventKind, INNOVATION, MODEL_STATE, Severity, event_topic};

    use super::*;

    fn state(known: MonitorState, learnt: f64, cusum: f64) -> ModelState {
        let (tick, departed_tick) = (24_000, 4000);
        let site = ModelSite::Line.code();
        let state = known.code();
        ModelState { tick, departed_tick, learnt, cusum, site, state, ..ModelState::default() }
    }

    #[test]
    fn an_axis_has_its_state_innovation_sum_and_place() {
        let mut rows = ModelRows::default();
        assert_eq!(rows.render(Some(2000.0), 0), Default::default());
        let mut see = |of: ModelState| {
            rows.reset();
            rows.observe(&MODEL_STATE.topic, of.as_bytes());
            for master in [0.001, -0.001] {
                let row =
                    Innovation { master, slave: 0.02, slave_present: 1, ..Innovation::default() };
                rows.observe(&INNOVATION.topic, row.as_bytes());
            }
            let (table, words) = rows.render(Some(2000.0), 0);
            (table[1].split_whitespace().map(str::to_owned).collect::<Vec<_>>(), words)
        };
        let (learning, words) = see(state(MonitorState::Learning, 0.25, 0.0));
        assert_eq!(learning, ["axis", "0", "learning", "25", "%", "0.0573", "1.1459", "-"]);
        assert!(words.is_empty());
        let (steady, _) = see(state(MonitorState::Steady, 1.0, 0.75));
        let cells = ["axis", "0", "agrees", "0.0573", "1.1459", "███░░░░░░░", "0.8"];
        assert_eq!(steady, cells);
        let (departed, words) = see(state(MonitorState::Departed, 1.0, 75.0));
        assert_eq!(departed[2], "DEPARTED");
        assert_eq!(departed[5..], ["██████████", "75.0", "line"]);
        assert!(words[0].starts_with("axis 0: DEPARTED 10 s ago at the line: see the events"));
    }

    #[test]
    fn the_event_gives_the_likely_effect_and_the_head_fits_80_columns() {
        let mut rows = ModelRows::default();
        rows.observe(&MODEL_STATE.topic, state(MonitorState::Departed, 1.0, 3.0).as_bytes());
        let topic = event_topic(Process::Monitor).unwrap().topic;
        let (kind, severity) = (EventKind::ModelDeparted, Severity::Warning);
        let event = Event::new(Process::Monitor, kind, severity, "handle: as leakage@line=1");
        rows.observe(&topic, event.as_bytes());
        let (table, words) = rows.render(Some(2000.0), 0);
        assert!(words[0].contains("at the line: handle: as leakage@line=1 ("), "{words:?}");
        assert_eq!(table.iter().find(|line| line.chars().count() > 79), None, "{table:?}");
        // Without the rows of a screen there is no innovation.
        assert!(table[1].contains(" - "), "{table:?}");
    }
}

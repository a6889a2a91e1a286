//! What the monitor says of the machine, in words: the same in the status, on the console, in the
//! probe and in a recording's summary.

use serde::Serialize;

use crate::message::Message as _;
use crate::{
    AXES, Event, EventKind, MODEL_DEPARTURE_SCORE, MODEL_DEPARTURE_SUM, ModelSite, ModelState,
    MonitorState,
};

/// A state that is older than this says nothing of the present: the monitor publishes each axis
/// once a second while samples come (ns).
const SILENT_NS: u64 = 3_000_000_000;

/// The model beside one axis of the machine.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ModelStatus {
    /// Index of the axis.
    pub axis: usize,
    /// What the monitor knows of it.
    pub state: MonitorState,
    /// Share of the baseline that is learnt, 0 to 1.
    pub learnt: f64,
    /// Innovation of master and slave over the baseline, as amplitudes; `null` while it is learnt.
    pub ratios: Option<[f64; 2]>,
    /// Cumulative sum; above 2.5 the machine has departed. `null` while the baseline is learnt.
    pub sum: Option<f64>,
    /// Score of the listed changes; above 5 the machine has departed, too. `null` while the
    /// baseline is learnt, and where nothing is scored.
    pub score: Option<f64>,
    /// Where the machine departed; `null` where it did not.
    pub site: Option<ModelSite>,
    /// What explains most of the departure, or why the axis is not monitored, in words.
    pub origin: Option<String>,
    /// Time since the departure began (s), by the samples.
    pub since_s: Option<f64>,
    /// Time since the monitor last said anything (s); `null` while it does each second.
    pub silent_s: Option<f64>,
}

impl ModelStatus {
    /// From the newest state, and the event of the departure; ticks come at `rate_hz`, if that is
    /// known.
    fn new(
        state: &ModelState,
        departure: Option<&Event>,
        rate_hz: Option<f64>,
        now_ns: u64,
    ) -> Self {
        let known = MonitorState::from_code(state.state).unwrap_or(MonitorState::Blind);
        let departed = known == MonitorState::Departed;
        let site = ModelSite::from_code(state.site).filter(|_| departed);
        let is_learnt = state.learnt >= 1.0;
        let ticks = state.tick.saturating_sub(state.departed_tick) as f64;
        let age_ns = now_ns.saturating_sub(state.time_ns());
        Self {
            axis: usize::from(state.axis),
            state: known,
            learnt: state.learnt,
            ratios: is_learnt.then_some([state.master_ratio, state.slave_ratio]),
            sum: is_learnt.then_some(state.cusum),
            score: Some(state.score).filter(|score| is_learnt && *score > 0.0),
            site: site.filter(|site| *site != ModelSite::None),
            origin: departure.filter(|_| departed).map(|event| event.text().to_owned()),
            since_s: rate_hz.filter(|_| departed).map(|rate_hz| ticks / rate_hz),
            silent_s: (age_ns > SILENT_NS).then_some(age_ns as f64 * 1e-9),
        }
    }

    /// One that is not monitored, for the reason in the event.
    fn blind(axis: usize, event: &Event) -> Self {
        Self {
            axis,
            state: MonitorState::Blind,
            learnt: 0.0,
            ratios: None,
            sum: None,
            score: None,
            site: None,
            origin: Some(event.text().to_owned()),
            since_s: None,
            silent_s: None,
        }
    }

    /// Whether the machine has departed from the model.
    pub fn is_departed(&self) -> bool {
        self.state == MonitorState::Departed
    }

    /// The state in a word.
    pub const fn word(&self) -> &'static str {
        match self.state {
            MonitorState::Steady => "agrees",
            MonitorState::Departed => "DEPARTED",
            state => state.text(),
        }
    }

    /// One sentence: `axis 0: DEPARTED 5 s ago at the slave: ...`.
    pub fn sentence(&self) -> String {
        let axis = self.axis;
        let numbers = || {
            let [master, slave] = self.ratios.unwrap_or_default();
            let sum = self.sum.unwrap_or_default();
            let score = self.score.map_or_else(String::new, |score| {
                format!(", score {score:.1} of {MODEL_DEPARTURE_SCORE}")
            });
            format!(
                "innovation of master and slave {master:.1} and {slave:.1} times the usual, sum \
                 {sum:.1} of {MODEL_DEPARTURE_SUM}{score}"
            )
        };
        let mut text = format!("axis {axis}: {}", self.word());
        text += &match self.state {
            MonitorState::Learning => format!(", {:.0} % while it moves", 100.0 * self.learnt),
            MonitorState::Blind => {
                self.origin.as_deref().map_or_else(String::new, |reason| format!(": {reason}"))
            }
            MonitorState::Steady | MonitorState::Suspicious => format!("; {}", numbers()),
            MonitorState::Departed => {
                let since = self.since_s.map(|since_s| format!(" {since_s:.0} s ago"));
                format!(
                    "{} at the {}: {} ({})",
                    since.unwrap_or_default(),
                    self.site.map_or("unknown side", ModelSite::text),
                    self.origin.as_deref().unwrap_or("see the events"),
                    numbers(),
                )
            }
        };
        if let Some(silent_s) = self.silent_s {
            text += &format!("; nothing new for {silent_s:.0} s");
        }
        text
    }
}

/// The newest that the monitor said of each axis.
#[derive(Clone, Debug, Default)]
pub struct NewestModel {
    states: [Option<ModelState>; AXES],
    /// Events that tell where an axis departed, or why it is not monitored.
    told: [Option<Event>; AXES],
}

impl NewestModel {
    /// Takes a state.
    pub fn see_state(&mut self, state: &ModelState) {
        if let Some(newest) = self.states.get_mut(usize::from(state.axis)) {
            *newest = Some(*state);
        }
    }

    /// Takes an event of the monitor.
    pub fn see_event(&mut self, event: &Event) {
        let (departed, blind) = (EventKind::ModelDeparted.code(), EventKind::NotMonitored.code());
        if (event.kind == departed || event.kind == blind)
            && let Some(told) = self.told.get_mut(event.a as usize)
        {
            *told = Some(*event);
        }
    }

    /// The model beside each axis of which anything is known, at `now_ns` (`CLOCK_MONOTONIC`), for
    /// ticks that come at `rate_hz`; without a rate no age is told.
    pub fn status(&self, rate_hz: Option<f64>, now_ns: u64) -> Vec<ModelStatus> {
        let axis = |(axis, (state, told)): (usize, (&Option<ModelState>, &Option<Event>))| {
            let is = |kind: EventKind| move |event: &&Event| event.kind == kind.code();
            let departure = told.as_ref().filter(is(EventKind::ModelDeparted));
            match state {
                Some(state) => Some(ModelStatus::new(state, departure, rate_hz, now_ns)),
                None => {
                    let blind = told.as_ref().filter(is(EventKind::NotMonitored))?;
                    Some(ModelStatus::blind(axis, blind))
                }
            }
        };
        self.states.iter().zip(&self.told).enumerate().filter_map(axis).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Process, Severity};

    fn departed() -> ModelState {
        let mut state = ModelState {
            tick: 5000,
            departed_tick: 1000,
            learnt: 1.0,
            master_ratio: 1.5,
            slave_ratio: 8.0,
            cusum: 4.25,
            score: 6.5,
            state: MonitorState::Departed.code(),
            site: ModelSite::Slave.code(),
            ..ModelState::default()
        };
        state.stamp(1, 2, 3, 1_000_000_000);
        state
    }

    fn event(kind: EventKind, text: &str) -> Event {
        Event::new(Process::Monitor, kind, Severity::Warning, text)
    }

    fn of(state: ModelState, now_ns: u64) -> ModelStatus {
        let mut newest = NewestModel::default();
        newest.see_state(&state);
        let text = "handle: as backlash@slave=0.050 rad, which explains 92 % of it";
        newest.see_event(&event(EventKind::ModelDeparted, text));
        newest.status(Some(2000.0), now_ns).remove(0)
    }

    #[test]
    fn a_departure_is_told_with_its_place_age_and_sum() {
        let status = of(departed(), 1_500_000_000);
        assert_eq!(
            status.sentence(),
            "axis 0: DEPARTED 2 s ago at the slave: handle: as backlash@slave=0.050 rad, which \
             explains 92 % of it (innovation of master and slave 1.5 and 8.0 times the usual, sum \
             4.2 of 2.5, score 6.5 of 5)"
        );
        // One that is over is not told any more.
        let over = of(ModelState { state: MonitorState::Steady.code(), ..departed() }, 0);
        assert_eq!((over.site, over.origin.as_ref(), over.since_s), (None, None, None));
        let agrees = "axis 0: agrees; innovation of master and slave 1.5 and 8.0 times the usual, \
                      sum 4.2 of 2.5, score 6.5 of 5";
        assert_eq!(over.sentence(), agrees);
        let unscored = of(ModelState { score: 0.0, ..departed() }, 0);
        assert_eq!(unscored.score, None);
        assert!(unscored.sentence().ends_with("sum 4.2 of 2.5)"), "{}", unscored.sentence());
    }

    #[test]
    fn without_a_rate_or_an_event_a_departure_is_told_all_the_same() {
        let mut newest = NewestModel::default();
        newest.see_state(&departed());
        let sentence = newest.status(None, 0).remove(0).sentence();
        assert!(sentence.starts_with("axis 0: DEPARTED at the slave: see the events ("));
    }

    #[test]
    fn what_is_learnt_has_no_numbers_yet() {
        let learning = ModelState {
            learnt: 0.4,
            state: MonitorState::Learning.code(),
            departed_tick: 0,
            ..departed()
        };
        let status = of(learning, 0);
        assert_eq!((status.ratios, status.sum), (None, None));
        assert_eq!(status.sentence(), "axis 0: learning, 40 % while it moves");
    }

    #[test]
    fn a_silent_monitor_is_told() {
        assert_eq!(of(departed(), 3_900_000_000).silent_s, None);
        let status = of(departed(), 13_000_000_000);
        assert!(status.sentence().ends_with("; nothing new for 12 s"), "{}", status.sentence());
    }

    #[test]
    fn an_axis_that_is_not_monitored_has_its_reason() {
        let mut newest = NewestModel::default();
        assert!(newest.status(None, 0).is_empty());
        let reason = "axes.unit: the model beside the machine needs an axis that turns";
        newest.see_event(&Event { a: 1.0, ..event(EventKind::NotMonitored, reason) });
        // No such axis.
        newest.see_event(&Event { a: 77.0, ..event(EventKind::NotMonitored, reason) });
        let status = newest.status(None, 0);
        assert_eq!(status.len(), 1);
        assert_eq!(status[0].sentence(), format!("axis 1: not monitored: {reason}"));
    }
}

//! The model beside the machine, in the status.

use ipc_types::{AXES, Event, EventKind, ModelSite, ModelState, MonitorState, event_topic};
use ipc_types::{MODEL_STATE, Process};
use runtime::{PortError, Subscriber};
use serde::Serialize;

use crate::{Error, RigLink};

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
    /// Where the machine departed; `null` where it did not.
    pub site: Option<ModelSite>,
    /// What explains most of the departure, in words.
    pub origin: Option<String>,
    /// Time since the departure began (s), by the samples.
    pub since_s: Option<f64>,
}

impl ModelStatus {
    /// From the newest state and the event of the departure; samples come at `rate_hz`.
    fn new(state: &ModelState, departure: Option<&Event>, rate_hz: f64) -> Self {
        let known = MonitorState::from_code(state.state).unwrap_or(MonitorState::Blind);
        let departed = known == MonitorState::Departed;
        let site = ModelSite::from_code(state.site).filter(|_| departed);
        Self {
            axis: usize::from(state.axis),
            state: known,
            learnt: state.learnt,
            ratios: (state.learnt >= 1.0).then_some([state.master_ratio, state.slave_ratio]),
            site: site.filter(|site| *site != ModelSite::None),
            origin: departure.filter(|_| departed).map(|event| event.text().to_owned()),
            since_s: departed
                .then(|| state.tick.saturating_sub(state.departed_tick) as f64 / rate_hz),
        }
    }

    /// The line of the status.
    pub(super) fn line(&self) -> String {
        let axis = self.axis;
        let [master, slave] = self.ratios.unwrap_or_default();
        match self.state {
            MonitorState::Learning => {
                format!(
                    "model     axis {axis}: learning, {:.0} % while it moves",
                    100.0 * self.learnt
                )
            }
            MonitorState::Blind => format!("model     axis {axis}: {}", self.state),
            MonitorState::Departed => format!(
                "model     axis {axis}: DEPARTED {:.0} s ago at the {}: {} ({master:.1} and \
                 {slave:.1} times the usual innovation)",
                self.since_s.unwrap_or(0.0),
                self.site.map_or("unknown side", ModelSite::text),
                self.origin.as_deref().unwrap_or("see the events"),
            ),
            MonitorState::Steady | MonitorState::Suspicious => format!(
                "model     axis {axis}: {}; innovation of master and slave {master:.1} and \
                 {slave:.1} times the usual",
                self.state
            ),
        }
    }
}

/// Reads what the monitor publishes.
pub(super) struct ModelReader {
    states: Subscriber<ModelState>,
    events: Option<Subscriber<Event>>,
    newest: [Option<ModelState>; AXES],
    departures: [Option<Event>; AXES],
}

impl ModelReader {
    pub(super) fn new(link: &RigLink) -> Result<Self, Error> {
        Ok(Self {
            states: link.subscriber(MODEL_STATE)?,
            events: event_topic(Process::Monitor)
                .map(|topic| link.subscriber(topic))
                .transpose()?,
            newest: [None; AXES],
            departures: [None; AXES],
        })
    }

    pub(super) fn read(&mut self) -> Result<(), PortError> {
        while let Some(state) = self.states.take()? {
            if let Some(newest) = self.newest.get_mut(usize::from(state.axis)) {
                *newest = Some(state);
            }
        }
        while let Some(events) = &mut self.events
            && let Some(event) = events.take()?
        {
            if event.kind == EventKind::ModelDeparted.code()
                && let Some(departure) = self.departures.get_mut(event.a as usize)
            {
                *departure = Some(event);
            }
        }
        Ok(())
    }

    /// The model beside each axis that is monitored, for samples at this rate (Hz).
    pub(super) fn status(&self, rate_hz: f64) -> Vec<ModelStatus> {
        let both = self.newest.iter().zip(&self.departures);
        both.filter_map(|(state, departure)| {
            Some(ModelStatus::new(state.as_ref()?, departure.as_ref(), rate_hz))
        })
        .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_departure_is_told_with_its_place_and_age() {
        let state = ModelState {
            tick: 5000,
            departed_tick: 1000,
            learnt: 1.0,
            master_ratio: 1.5,
            slave_ratio: 8.0,
            state: MonitorState::Departed.code(),
            site: ModelSite::Slave.code(),
            ..ModelState::default()
        };
        let text = "handle: as backlash@slave=0.050 rad, which explains 92 % of it";
        let (kind, severity) = (EventKind::ModelDeparted, ipc_types::Severity::Warning);
        let event = Event::new(Process::Monitor, kind, severity, text);
        let status = ModelStatus::new(&state, Some(&event), 2000.0);
        let line = status.line();
        assert!(line.contains("DEPARTED 2 s ago at the slave: handle: as backlash"), "{line}");
        // One that is over is not told any more.
        let over = ModelState { state: MonitorState::Steady.code(), ..state };
        let status = ModelStatus::new(&over, Some(&event), 2000.0);
        assert_eq!((status.site, status.origin), (None, None));
    }
}

//! What the monitor said of the machine: its events with their places, and its last state.

use ipc_types::{
    AXES, Event, EventKind, MODEL_STATE, ModelSite, ModelState, NewestModel, Process, event_topic,
};
use recording::mcap_read::Recording;
use report::Colour;
use serde::Serialize;

/// An event of the monitor.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Happened {
    /// Time since the recording began (s).
    t_s: f64,
    /// What.
    event: &'static str,
    /// The axis.
    axis: usize,
    /// Where the machine departed; `null` for other events.
    site: Option<ModelSite>,
    /// More of it.
    text: String,
}

/// Where each axis departed last, by its states, of which one precedes each event.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sites([Option<ModelSite>; AXES]);

impl Sites {
    /// Takes a state.
    pub(crate) fn see(&mut self, state: &ModelState) {
        if let Some(site) = self.0.get_mut(usize::from(state.axis)) {
            *site = ModelSite::from_code(state.site).filter(|site| *site != ModelSite::None);
        }
    }
}

impl Happened {
    /// An event at a time since the recording began (s), after the states in `sites`.
    pub(crate) fn new(event: &Event, t_s: f64, sites: &Sites) -> Self {
        let kind = EventKind::from_code(event.kind);
        let axis = event.a as usize;
        let departed = kind == Some(EventKind::ModelDeparted);
        Self {
            t_s,
            event: kind.map_or("unknown", EventKind::text),
            axis,
            site: sites.0.get(axis).copied().flatten().filter(|_| departed),
            text: event.text().to_owned(),
        }
    }

    /// Whether the machine departed from its model.
    pub(crate) fn is_departure(&self) -> bool {
        self.event == EventKind::ModelDeparted.text()
    }

    /// When it happened (s) and the colour of its mark, on the figures of that axis.
    pub(crate) fn mark(&self, axis: usize) -> Option<(f64, Colour)> {
        let marks = [
            (EventKind::BaselineLearnt, Colour::Grey),
            (EventKind::ModelDeparted, Colour::Orange),
            (EventKind::ModelReturned, Colour::Green),
        ];
        let own = marks.into_iter().find(|(kind, _)| self.event == kind.text());
        own.filter(|_| self.axis == axis).map(|(_, colour)| (self.t_s, colour))
    }

    /// Time (s), axis, event, place, and more of it: a row of a table.
    pub(crate) fn cells(&self) -> [String; 5] {
        let Self { t_s, event, axis, site, text } = self;
        let place = site.map_or_else(String::new, |site| site.to_string());
        [format!("{t_s:.3}"), axis.to_string(), (*event).to_owned(), place, text.clone()]
    }

    /// `   41.020 s  axis 0: model departed at the slave: handle: as backlash@slave=0.050 rad`.
    pub(crate) fn line(&self) -> String {
        let Self { t_s, event, axis, site, text } = self;
        let place = site.map_or_else(String::new, |site| format!(" at the {site}"));
        format!("{t_s:>9.3} s  axis {axis}: {event}{place}: {text}")
    }
}

/// What the monitor said in a recording.
#[derive(Debug, Default, Serialize)]
pub(crate) struct Monitored {
    /// Baselines, departures, returns, and axes that were not monitored, in the order of time.
    pub(crate) events: Vec<Happened>,
    /// The last that it said of each axis, in a sentence.
    pub(crate) last: Vec<String>,
}

impl Monitored {
    /// Reads it; empty where no monitor ran.
    ///
    /// # Errors
    /// Those of reading.
    pub(crate) fn read(recording: &Recording) -> anyhow::Result<Self> {
        let mut states = Vec::new();
        for message in recording.messages_if_any::<ModelState>(MODEL_STATE.topic.name)? {
            states.push(message?.message);
        }
        let (began_ns, mut newest, mut sites) =
            (recording.began_monotonic_ns(), NewestModel::default(), Sites::default());
        let (mut events, mut waiting) = (Vec::new(), states.iter().peekable());
        let topic = event_topic(Process::Monitor).map_or("", |topic| topic.topic.name);
        for message in recording.messages_if_any::<Event>(topic)? {
            let event: Event = message?.message;
            while let Some(state) = waiting.next_if(|state| state.time_ns <= event.time_ns) {
                sites.see(state);
            }
            newest.see_event(&event);
            if is_of_the_model(event.kind) {
                let t_s = (event.time_ns as f64 - began_ns as f64) * 1e-9;
                events.push(Happened::new(&event, t_s, &sites));
            }
        }
        states.iter().for_each(|state| newest.see_state(state));
        // Without a rate: how long ago it was says nothing here.
        let now_ns = states.last().map_or(0, |state| state.time_ns);
        let last = newest.status(None, now_ns).iter().map(|axis| axis.sentence()).collect();
        Ok(Self { events, last })
    }
}

/// Not that the process started or ended.
fn is_of_the_model(kind: u8) -> bool {
    let kind = EventKind::from_code(kind);
    kind.is_some_and(|kind| {
        matches!(
            kind,
            EventKind::BaselineLearnt
                | EventKind::ModelDeparted
                | EventKind::ModelReturned
                | EventKind::NotMonitored
        )
    })
}

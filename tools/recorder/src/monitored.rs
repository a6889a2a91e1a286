//! What the monitor said of the machine: its events with their places, and its last state.

use ipc_types::{
    AXES, Event, EventKind, MODEL_STATE, ModelSite, ModelState, NewestModel, Process, event_topic,
};
use recording::mcap_read::{ReadError, Recorded, Recording};
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
    /// Reads it; empty where no monitor ran. Of the states, which come all the time, only the
    /// newest ones and those before departures are read.
    ///
    /// # Errors
    /// Those of reading; a damaged chunk is none.
    pub(crate) fn read(recording: &Recording) -> anyhow::Result<Self> {
        let (began_ns, mut newest) = (recording.began_monotonic_ns(), NewestModel::default());
        let (mut events, mut blind) = (Vec::new(), [false; AXES]);
        let topic = event_topic(Process::Monitor).map_or("", |topic| topic.topic.name);
        for message in recording.messages_if_any::<Event>(topic)? {
            let Some(Recorded { log_time_ns, message: event }) = unless_damaged(message)? else {
                continue;
            };
            newest.see_event(&event);
            let kind = EventKind::from_code(event.kind);
            if kind == Some(EventKind::NotMonitored)
                && let Some(blind) = blind.get_mut(event.a as usize)
            {
                *blind = true;
            }
            if is_of_the_model(event.kind) {
                let t_s = (event.time_ns as f64 - began_ns as f64) * 1e-9;
                let mut sites = Sites::default();
                if kind == Some(EventKind::ModelDeparted) {
                    state_before(recording, &event, log_time_ns)?
                        .iter()
                        .for_each(|state| sites.see(state));
                }
                events.push(Happened::new(&event, t_s, &sites));
            }
        }
        let now_ns = newest_states(recording, blind, &mut newest)?;
        // Without a rate: how long ago it was says nothing here.
        let last = newest.status(None, now_ns).iter().map(|axis| axis.sentence()).collect();
        Ok(Self { events, last })
    }
}

/// What a damaged chunk holds is left out: the check of the whole recording tells of it.
fn unless_damaged<T>(read: Result<T, ReadError>) -> Result<Option<T>, ReadError> {
    match read {
        Ok(read) => Ok(Some(read)),
        Err(ReadError::Damaged { .. }) => Ok(None),
        Err(error) => Err(error),
    }
}

/// The newest state of an event's axis when it happened.
fn state_before(
    recording: &Recording,
    event: &Event,
    log_time_ns: u64,
) -> anyhow::Result<Option<ModelState>> {
    let until_ns = Some(log_time_ns.saturating_add(1));
    for state in recording.backward::<ModelState>(MODEL_STATE.topic.name, until_ns)? {
        let Some(Recorded { message: state, .. }) = unless_damaged(state)? else { continue };
        if usize::from(state.axis) == event.a as usize && state.time_ns <= event.time_ns {
            return Ok(Some(state));
        }
    }
    Ok(None)
}

/// Shows the newest state of each axis; returns the time of the newest of all (ns). An axis that
/// is not monitored has none to look for.
fn newest_states(
    recording: &Recording,
    blind: [bool; AXES],
    newest: &mut NewestModel,
) -> anyhow::Result<u64> {
    let named = |axis: &usize| recording.metadata(&format!("axis.{axis}.name")).is_some();
    let axes = match (0..AXES).filter(named).count() {
        0 => AXES,
        axes => axes,
    };
    let (mut seen, mut now_ns) = ([false; AXES], None);
    for state in recording.backward::<ModelState>(MODEL_STATE.topic.name, None)? {
        let Some(Recorded { message: state, .. }) = unless_damaged(state)? else { continue };
        now_ns.get_or_insert(state.time_ns);
        if let Some(seen) = seen.get_mut(usize::from(state.axis))
            && !std::mem::replace(seen, true)
        {
            newest.see_state(&state);
        }
        if (0..axes).all(|axis| seen[axis] || blind[axis]) {
            break;
        }
    }
    Ok(now_ns.unwrap_or(0))
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

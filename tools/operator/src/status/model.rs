//! The model beside the machine, in the status.

use ipc_types::{Event, MODEL_STATE, ModelState, ModelStatus, NewestModel, Process, event_topic};
use runtime::{PortError, Subscriber};

use crate::{Error, RigLink};

/// Reads what the monitor publishes.
pub(super) struct ModelReader {
    states: Subscriber<ModelState>,
    events: Option<Subscriber<Event>>,
    newest: NewestModel,
}

impl ModelReader {
    pub(super) fn new(link: &RigLink) -> Result<Self, Error> {
        Ok(Self {
            states: link.subscriber(MODEL_STATE)?,
            events: event_topic(Process::Monitor)
                .map(|topic| link.subscriber(topic))
                .transpose()?,
            newest: NewestModel::default(),
        })
    }

    pub(super) fn read(&mut self) -> Result<(), PortError> {
        while let Some(state) = self.states.take()? {
            self.newest.see_state(&state);
        }
        while let Some(events) = &mut self.events
            && let Some(event) = events.take()?
        {
            self.newest.see_event(&event);
        }
        Ok(())
    }

    /// The model beside each axis of which anything is known, for samples at this rate (Hz).
    pub(super) fn status(&self, rate_hz: Option<f64>, now_ns: u64) -> Vec<ModelStatus> {
        self.newest.status(rate_hz, now_ns)
    }
}

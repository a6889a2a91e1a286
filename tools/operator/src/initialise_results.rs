//! The ranges of travel that a protocol's `initialise` segments find.

use ipc_types::{Event, EventKind, Process, Severity, event_topic};
use rig::{AxisUnit, RigFile};
use runtime::Subscriber;
use runtime::clock::now_ns;
use serde::Serialize;

use crate::{Error, RigLink};

/// The range of travel that an `initialise` segment found, as the handle's own encoder sees it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FoundRange {
    /// Axis, from 0.
    pub axis: usize,
    /// Lower end (rad or m).
    pub lower: f64,
    /// Upper end (rad or m).
    pub upper: f64,
    /// Whether the ends are in rad; else in m.
    pub in_radians: bool,
    /// Which ends were met, in words.
    pub text: String,
}

impl std::fmt::Display for FoundRange {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { axis, lower, upper, in_radians, text } = self;
        if *in_radians {
            let (lower, upper) = (lower.to_degrees(), upper.to_degrees());
            write!(out, "axis {axis}: range {lower:.2}° to {upper:.2}° ({text})")
        } else {
            write!(out, "axis {axis}: range {lower:.5} m to {upper:.5} m ({text})")
        }
    }
}

/// Reads the ranges found from the experiment's events.
pub(crate) struct Ranges {
    events: Option<Subscriber<Event>>,
    since_ns: u64,
    rig: RigFile,
}

impl Ranges {
    pub(crate) fn new(link: &RigLink, rig: RigFile) -> Result<Self, Error> {
        let topic = event_topic(Process::Experiment);
        let events = topic.map(|topic| link.subscriber(topic)).transpose()?;
        Ok(Self { events, since_ns: now_ns(), rig })
    }

    pub(crate) fn read(&mut self, ranges: &mut Vec<FoundRange>) -> Result<(), Error> {
        let Some(events) = &mut self.events else { return Ok(()) };
        while let Some(event) = events.take()? {
            // The warning that follows repeats the range in the motor's coordinates.
            let found = event.kind == EventKind::RangeFound.code()
                && event.severity == Severity::Info.code()
                && event.time_ns >= self.since_ns;
            if found {
                let axis = event.c as usize;
                let unit = self.rig.axes.get(axis).map(|axis| axis.unit);
                ranges.push(FoundRange {
                    axis,
                    lower: event.a,
                    upper: event.b,
                    in_radians: unit != Some(AxisUnit::Metre),
                    text: event.text().to_owned(),
                });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_range_is_shown_in_degrees_or_metres() {
        let text = "both ends met, as the handle sees them".to_owned();
        let range = FoundRange { axis: 0, lower: -0.5, upper: 0.25, in_radians: true, text };
        assert_eq!(
            range.to_string(),
            "axis 0: range -28.65° to 14.32° (both ends met, as the handle sees them)"
        );
        let range = FoundRange { in_radians: false, ..range };
        assert!(range.to_string().starts_with("axis 0: range -0.50000 m to 0.25000 m"));
    }
}

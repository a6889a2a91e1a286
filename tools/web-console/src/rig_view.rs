//! The rig as the operator sees it: the newest messages of its topics.

use ipc_types::{
    EnableToken, Event, EventKind, GateState, Mode, ModelStatus, NewestModel, Performance, Process,
    Sample, Severity, TripCause, WatchdogState,
};
use rig::{AxisUnit, RigFile};
use serde_json::{Value, json};

/// A message that is older says nothing of the present (ns).
const FRESH_NS: u64 = 300_000_000;

/// Newest messages.
#[derive(Default)]
pub(crate) struct RigView {
    pub(crate) token: Option<EnableToken>,
    pub(crate) sample: Option<Sample>,
    pub(crate) performance: Option<Performance>,
    /// What control does, with the time of its command (ns).
    pub(crate) mode: Option<(Mode, u64)>,
    /// What the protocol told the subject at the beginning of the segment.
    pub(crate) told: Option<String>,
    /// What the monitor says of the model beside the machine.
    pub(crate) model: NewestModel,
}

impl RigView {
    /// Takes an event of any process.
    pub(crate) fn see(&mut self, event: &Event) {
        match Process::from_code(event.source) {
            Some(Process::Experiment) => self.see_experiment(event),
            Some(Process::Monitor) => self.model.see_event(event),
            _ => {}
        }
    }

    /// What the subject is told holds for one segment.
    fn see_experiment(&mut self, event: &Event) {
        match EventKind::from_code(event.kind) {
            Some(EventKind::Instruction) => self.told = Some(event.text().to_owned()),
            Some(
                EventKind::ProtocolStarted
                | EventKind::SegmentStarted
                | EventKind::ProtocolResumed
                | EventKind::ProtocolDone
                | EventKind::ProtocolStopped,
            ) => self.told = None,
            _ => {}
        }
    }

    /// State of the watchdog; `None` where it is silent.
    pub(crate) fn watchdog(&self, now_ns: u64) -> Option<WatchdogState> {
        let token = self.token.filter(|token| is_fresh(token.time_ns, now_ns))?;
        WatchdogState::from_code(token.state)
    }

    /// What control does now; `None` where it is silent.
    pub(crate) fn mode(&self, now_ns: u64) -> Option<Mode> {
        self.mode.filter(|(_, at_ns)| is_fresh(*at_ns, now_ns)).map(|(mode, _)| mode)
    }

    /// Interlocks, gate, homing and handle, and the model beside the machine.
    pub(crate) fn state(&self, rig: &RigFile, now_ns: u64) -> Value {
        let token = self.token.filter(|token| is_fresh(token.time_ns, now_ns));
        let sample = self.sample.filter(|sample| is_fresh(sample.time_ns, now_ns));
        let cause = token.and_then(|token| TripCause::from_code(token.cause));
        let latched =
            matches!(self.watchdog(now_ns), Some(WatchdogState::Faulted | WatchdogState::Tripped));
        let faults = TripCause::ALL
            .iter()
            .filter(|cause| token.is_some_and(|token| token.faults & 1 << cause.code() != 0));
        json!({
            "watchdog": self.watchdog(now_ns),
            "cause": cause.filter(|_| latched).map(TripCause::text),
            "faults": faults.map(|cause| cause.text()).collect::<Vec<_>>(),
            "gate_open": sample.map(|sample| sample.gate_state == GateState::Open.code()),
            "mode": self.mode(now_ns).map(Mode::text),
            "axes": sample.map(|sample| axes(rig, &sample, token.as_ref())),
            "model": self.model(rig, now_ns),
        })
    }

    /// The model beside each axis; empty without the monitor.
    fn model(&self, rig: &RigFile, now_ns: u64) -> Vec<Value> {
        let rate_hz = f64::from(rig.rates.acquisition_hz);
        let status = self.model.status(Some(rate_hz), now_ns);
        let axis = |axis: &ModelStatus| {
            json!({
                "axis": axis.axis,
                "state": axis.state,
                "departed": axis.is_departed(),
                "text": axis.sentence(),
            })
        };
        status.iter().map(axis).collect()
    }
}

fn is_fresh(time_ns: u64, now_ns: u64) -> bool {
    now_ns.saturating_sub(time_ns) < FRESH_NS
}

/// Position and homing of each axis, and whether it has a range of motion that is not in force.
fn axes(rig: &RigFile, sample: &Sample, token: Option<&EnableToken>) -> Vec<Value> {
    let unsupervised = token.map_or(0, |token| token.range_given & !token.range_supervised);
    let axis = |(at, axis): (usize, &rig::Axis)| {
        let (position, unit) = match axis.unit {
            AxisUnit::Radian => (sample.master_position[at].to_degrees(), "°"),
            AxisUnit::Metre => (sample.master_position[at] * 1e3, "mm"),
        };
        json!({
            "name": axis.name,
            "position": (sample.master_present & 1 << at != 0).then_some(position),
            "unit": unit,
            "homed": sample.homed & 1 << at != 0,
            "range_not_in_force": unsupervised & 1 << at != 0,
        })
    };
    rig.axes.iter().take(usize::from(sample.axes)).enumerate().map(axis).collect()
}

/// An event as pages are told it.
pub(crate) fn event(event: &Event, now_ns: u64) -> Value {
    let word = |text: Option<&'static str>| text.unwrap_or("unknown");
    json!({
        "type": "event",
        "age_ms": now_ns.saturating_sub(event.time_ns) / 1_000_000,
        "at_ms": event.time_ns as f64 / 1e6,
        "source": word(Process::from_code(event.source).map(Process::text)),
        "kind": word(EventKind::from_code(event.kind).map(EventKind::text)),
        "severity": word(Severity::from_code(event.severity).map(Severity::text)),
        "a": event.a,
        "b": event.b,
        "text": event.text(),
    })
}

/// The events of which the subject's page may make a sound.
pub(crate) const SOUNDS: [EventKind; 4] =
    [EventKind::Beat, EventKind::SessionStarted, EventKind::SessionOver, EventKind::Sound];

/// Whether the subject's page is told of an event.
pub(crate) fn is_for_subjects(event: &Event) -> bool {
    EventKind::from_code(event.kind).is_some_and(|kind| SOUNDS.contains(&kind))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used)]

    use std::path::Path;

    use ipc_types::{Message as _, ModelSite, ModelState, MonitorState};

    use super::*;

    #[test]
    fn a_silent_watchdog_has_no_state() {
        let rig = rig::load_rig(Path::new("hydrostatic")).unwrap();
        let token = EnableToken {
            time_ns: 1_000_000_000,
            state: WatchdogState::Tripped.code(),
            cause: TripCause::SpeedLimit.code(),
            faults: 1 << TripCause::ControlLost.code(),
            ..EnableToken::default()
        };
        let view = RigView { token: Some(token), ..RigView::default() };
        let state = view.state(&rig, 1_100_000_000);
        assert_eq!(state["watchdog"], "tripped");
        assert_eq!(state["cause"], "speed limit");
        assert_eq!(state["faults"], json!(["control lost"]));
        let later = view.state(&rig, 1_400_000_000);
        assert_eq!((&later["watchdog"], &later["cause"]), (&Value::Null, &Value::Null));
    }

    #[test]
    fn an_instruction_holds_for_its_segment() {
        let mut view = RigView::default();
        let mut see = |kind, text| {
            view.see(&Event::new(Process::Experiment, kind, Severity::Info, text));
            view.told.clone()
        };
        assert_eq!(see(EventKind::SegmentStarted, "rest"), None);
        assert_eq!(see(EventKind::Instruction, "Relax."), Some("Relax.".to_owned()));
        assert_eq!(see(EventKind::Beat, ""), Some("Relax.".to_owned()));
        assert_eq!(see(EventKind::SegmentStarted, "next"), None);
    }

    #[test]
    fn a_departed_model_is_told_as_in_the_status() {
        let rig = rig::load_rig(Path::new("hydrostatic")).unwrap();
        let mut view = RigView::default();
        assert_eq!(view.state(&rig, 0)["model"], json!([]));
        let mut state = ModelState {
            tick: 5000,
            departed_tick: 1000,
            learnt: 1.0,
            slave_ratio: 8.0,
            cusum: 4.25,
            state: MonitorState::Departed.code(),
            site: ModelSite::Slave.code(),
            ..ModelState::default()
        };
        state.stamp(1, 2, 3, 0);
        view.model.see_state(&state);
        let text = "handle: as backlash@slave=0.050 rad";
        let (kind, severity) = (EventKind::ModelDeparted, Severity::Warning);
        view.see(&Event::new(Process::Monitor, kind, severity, text));
        let model = view.state(&rig, 1)["model"].clone();
        assert_eq!((&model[0]["state"], &model[0]["departed"]), (&json!("departed"), &json!(true)));
        assert_eq!(model[0]["text"], view.model.status(Some(2000.0), 1)[0].sentence());
        let told = model[0]["text"].as_str().unwrap();
        assert!(told.starts_with("axis 0: DEPARTED 2 s ago at the slave: handle: as"), "{told}");
        // Back again: the banner goes.
        view.model.see_state(&ModelState { state: MonitorState::Steady.code(), ..state });
        let model = view.state(&rig, 1)["model"].clone();
        assert_eq!(model[0]["departed"], false);
    }

    #[test]
    fn a_range_of_motion_that_is_not_in_force_is_told() {
        let rig = rig::load_rig(Path::new("hydrostatic")).unwrap();
        let sample = Sample { time_ns: 5, axes: 1, ..Sample::default() };
        let told = |range_given, range_supervised| {
            let token =
                EnableToken { time_ns: 5, range_given, range_supervised, ..EnableToken::default() };
            let view = RigView { sample: Some(sample), token: Some(token), ..RigView::default() };
            view.state(&rig, 6)["axes"][0]["range_not_in_force"].clone()
        };
        assert_eq!([told(0, 0), told(1, 1), told(1, 0)], [json!(false), json!(false), json!(true)]);
    }

    #[test]
    fn positions_are_in_degrees() {
        let rig = rig::load_rig(Path::new("hydrostatic")).unwrap();
        let mut sample =
            Sample { time_ns: 5, axes: 1, homed: 1, master_present: 1, ..Sample::default() };
        sample.master_position[0] = std::f64::consts::FRAC_PI_2;
        let view = RigView { sample: Some(sample), ..RigView::default() };
        let axis = view.state(&rig, 6)["axes"][0].clone();
        assert!((axis["position"].as_f64().unwrap() - 90.0).abs() < 1e-9);
        assert_eq!((&axis["homed"], &axis["unit"]), (&json!(true), &json!("°")));
    }
}

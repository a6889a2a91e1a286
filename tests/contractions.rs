//! Maximum voluntary contractions on a rig of real processes: what is measured, saved, used again
//! and recorded, with the instructions, sounds and pulses that belong to the sessions.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use emg::{MAXIMUM_WINDOW_S, MuscleActivity, MuscleSample};
use ipc_types::{
    EMG_MAXIMUM, EmgMaximum, Event, EventKind, Process, SAMPLE, SESSION, SYNC_ORDER, Sample,
    SessionOutcome, SessionResult, Severity, SyncOrder, event_topic,
};
use recording::mcap_read::Recording;
use rig::RigFile;

use common::playing::{messages, play_until};
use common::{TestRig, assert_told, told};

/// Digital output for the sessions, and the samples that its pulse lasts at least.
const OUTPUT: u32 = 2;
const LEAST_SAMPLES: usize = 30;

/// The shipped protocol, in six seconds.
const SHORT: [&str; 5] = [
    "--set=protocol.repeat=1",
    "--set=segments.0.duration_s=2",
    "--set=segments.1.duration_s=1",
    "--set=segments.2.duration_s=2",
    "--set=segments.3.duration_s=1",
];

fn run_mvc(rig: &TestRig, more: &[&str]) {
    let arguments = [&["run", "mvc"][..], &SHORT[..], more].concat();
    let ended = play_until(rig, &arguments, "completed");
    assert!(ended.status.success(), "{}", told(&ended));
}

/// Largest mean of a rectified signal over the window, as a person would compute it.
fn largest_mean(values: &[f64], rate_hz: f64) -> f64 {
    let length = (MAXIMUM_WINDOW_S * rate_hz).round() as usize;
    let means = values.windows(length).map(|window| window.iter().sum::<f64>() / length as f64);
    means.max_by(f64::total_cmp).unwrap()
}

fn close(found: f64, expected: f64, what: &str) {
    let error = (found - expected).abs();
    assert!(error <= 1e-9 * expected.abs().max(1.0), "{what}: {found} instead of {expected}");
}

/// A recording with what it shows.
struct Recorded {
    rig: RigFile,
    samples: Vec<Sample>,
    muscles: Vec<MuscleSample>,
    events: Vec<Event>,
    maxima: Vec<EmgMaximum>,
    results: Vec<SessionResult>,
    orders: Vec<SyncOrder>,
}

impl Recorded {
    fn read(recording: &Recording, rig: RigFile) -> Self {
        let samples: Vec<Sample> = messages(recording, SAMPLE.topic.name);
        let rate_hz = f64::from(rig.rates.acquisition_hz);
        let mut filters = MuscleActivity::new(&rig.electrodes(), &rig.emg, rate_hz).unwrap();
        let muscles = samples.iter().map(|sample| filters.update(&sample.analog_v, None)).collect();
        let topics = [Process::Experiment, Process::Acquisition];
        let events = topics.into_iter().flat_map(|process| {
            messages::<Event>(recording, event_topic(process).unwrap().topic.name)
        });
        Self {
            muscles,
            events: events.collect(),
            maxima: messages(recording, EMG_MAXIMUM.topic.name),
            results: messages(recording, SESSION.topic.name),
            orders: messages(recording, SYNC_ORDER.topic.name),
            samples,
            rig,
        }
    }

    fn of_kind(&self, kind: EventKind) -> Vec<&Event> {
        self.events.iter().filter(|event| event.kind == kind.code()).collect()
    }

    /// The rectified signal at an input in a time.
    fn rectified(&self, input: usize, from_ns: u64, to_ns: u64) -> Vec<f64> {
        let index = |at_ns| self.samples.partition_point(|sample| sample.scan_time_ns < at_ns);
        let muscles = &self.muscles[index(from_ns)..index(to_ns)];
        muscles.iter().map(|sample| sample.rectified[input]).collect()
    }
}

/// Each maximum of the second run is the one of the recorded samples, and each electrode of a group
/// has one. In the first one the filters still remember what was before the recording.
fn check_measured(recorded: &Recorded) {
    let rate_hz = f64::from(recorded.rig.rates.acquisition_hz);
    let measured: Vec<_> = recorded.maxima.iter().filter(|maximum| maximum.used == 0).collect();
    assert!(measured.len() >= 4, "{}", measured.len());
    let mut inputs = 0;
    for found in &measured[measured.len() - 2..] {
        assert!(found.inputs != 0);
        inputs |= found.inputs;
        for at in (0..16).filter(|at| found.inputs & 1 << at != 0) {
            let values = recorded.rectified(at, found.begun_ns, found.ended_ns);
            close(found.maximum[at], largest_mean(&values, rate_hz), "a maximum");
            assert!(found.maximum[at] > 0.0);
        }
    }
    let electrodes = recorded.rig.electrodes();
    assert_eq!(inputs, electrodes.iter().fold(0, |bits, it| bits | 1 << it.input));
}

/// The sums of the last session, which used the maxima of the first run, are shares of these.
fn check_shares(recorded: &Recorded) {
    let used = recorded.maxima.iter().rfind(|maximum| maximum.used == 1).unwrap();
    let whole = SessionOutcome::Whole.code();
    let result = recorded.results.iter().rfind(|result| result.outcome == whole).unwrap();
    assert!(result.begun_ns > used.begun_ns);
    let electrodes = recorded.rig.electrodes();
    for group in 0..2 {
        let of_group: Vec<_> =
            electrodes.iter().filter(|electrode| electrode.group.index() == group).collect();
        let mut expected = 0.0;
        for electrode in &of_group {
            let values = recorded.rectified(electrode.input, result.begun_ns, result.ended_ns);
            let sum: f64 = values.iter().sum();
            expected += sum / used.maximum[electrode.input] / of_group.len() as f64;
        }
        close(result.emg_sum[group], expected, "a sum of shares");
    }
}

/// Each session began with a pulse on the digital output, soon and as long as it should be.
fn check_pulses(recorded: &Recorded) {
    let high: Vec<bool> =
        recorded.samples.iter().map(|sample| sample.digital_out & 1 << OUTPUT != 0).collect();
    let rises: Vec<usize> = (1..high.len()).filter(|at| high[*at] && !high[at - 1]).collect();
    let pulses = recorded.of_kind(EventKind::SyncPulse);
    let given: Vec<_> =
        pulses.iter().filter(|event| event.severity == Severity::Info.code()).collect();
    assert_eq!(pulses.len(), recorded.orders.len());
    assert!(given.len() >= 4 && rises.len() == given.len(), "{} of {}", rises.len(), given.len());
    for (rise, event) in rises.into_iter().zip(given) {
        let order = recorded
            .orders
            .iter()
            .rfind(|order| order.at_ns < recorded.samples[rise].scan_time_ns)
            .unwrap();
        assert_eq!((event.a, event.c), (f64::from(order.number), f64::from(OUTPUT)));
        assert!((0.0..0.1).contains(&event.b), "{} s after the session began", event.b);
        let width = high[rise..].iter().take_while(|high| **high).count();
        assert!(width >= LEAST_SAMPLES, "{width} samples");
    }
}

#[test]
fn maxima_are_measured_saved_and_used() {
    let rig = TestRig::patient("contractions");
    let absolute = rig.absolute_rig("hydrostatic");
    let text = std::fs::read_to_string(&absolute).unwrap();
    let rig_path = rig.path("synced.toml");
    let rig_text = format!("{text}\n[sync]\noutput = {OUTPUT}\nwidth_s = 0.02\n");
    std::fs::write(&rig_path, &rig_text).unwrap();
    let file = rig.path("mvc.mcap").to_str().unwrap().to_owned();
    rig.ok(["up", "--simulate", "--rig", rig_path.to_str().unwrap(), "--record", &file]);
    let nobody = ["run", "mvc", "--set=emg.load=nobody"];
    let unknown = play_until(&rig, &nobody, "nobody.emg.json");
    assert_told(&unknown, &["emg.load", "farreach run mvc"]);
    run_mvc(&rig, &["--set=emg.save=s07"]);
    run_mvc(&rig, &["--set=emg.save=again", "--set=emg.load=s07"]);
    let bad = rig.run(["run", "mvc", "--set=segments.0.session=false"]);
    assert_told(&bad, &["contraction", "session = true"]);
    rig.ok(["rec", "stop"]);
    rig.down();

    let recording = Recording::open(std::path::Path::new(&file)).unwrap();
    let recorded = Recorded::read(&recording, RigFile::parse(&rig_text, "synced.toml").unwrap());
    check_measured(&recorded);
    check_shares(&recorded);
    check_pulses(&recorded);
    let saved = recorded.of_kind(EventKind::MaximaSaved);
    let texts: Vec<&str> = saved.iter().map(|event| event.text()).collect();
    assert!(texts.contains(&"s07"), "{texts:?}");
    assert!(texts.contains(&"again"), "{texts:?}");
    let told: Vec<&str> =
        recorded.of_kind(EventKind::Instruction).iter().map(|event| event.text()).collect();
    let [.., first, relax, second, last] = told[..] else { panic!("{told:?}") };
    assert!(first.contains("positive direction") && second.contains("negative direction"));
    assert_eq!((relax, last), ("Relax.", "Relax."));
    let sounds: Vec<&str> =
        recorded.of_kind(EventKind::Sound).iter().map(|event| event.text()).collect();
    assert!(sounds.ends_with(&["high", "low", "high", "low"]), "{sounds:?}");
}

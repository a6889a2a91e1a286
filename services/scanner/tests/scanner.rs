//! Emulated scans: line to pulses, pulses to volumes.
#![allow(clippy::unwrap_used)]

use plant::sensors::{ScannerEmulator, ScannerTrigger, TriggerFaults};
use proptest::prelude::*;
use scanner::{
    Counted, Counts, Line, LineEvent, LineEventKind, LineKind, PulseDetector, Series, VolumeClock,
    reconcile,
};

/// Time between two samples at 2 kHz (ns).
const SAMPLE_NS: u64 = 500_000;
/// Start of all samples (ns): times are those of a machine that has been up for a while.
const START_NS: u64 = 86_400_000_000_000;

fn emulator(repetition_s: f64, pulse_s: f64, faults: TriggerFaults) -> ScannerEmulator {
    let trigger =
        ScannerTrigger { repetition_s, pulse_s, start_s: 1.0, ..ScannerTrigger::default() };
    ScannerEmulator { trigger, faults }.checked().unwrap()
}

/// The pulses and gates that a detector finds at 2 kHz, and the detector.
fn detect(
    line: Line,
    volts: impl Fn(f64) -> f64,
    duration_s: f64,
) -> (Vec<LineEvent>, PulseDetector) {
    let mut detector = PulseDetector::new(line);
    let samples = (duration_s * 2000.0).round() as u64;
    let pulses = (0..samples)
        .filter_map(|at| {
            let time_s = at as f64 / 2000.0;
            detector.observe(START_NS + at * SAMPLE_NS, volts(time_s))
        })
        .filter(|event| event.kind != LineEventKind::Glitch)
        .collect();
    (pulses, detector)
}

fn times(pulses: &[LineEvent]) -> Vec<u64> {
    pulses.iter().map(|pulse| pulse.at_ns).collect()
}

fn seconds(at_ns: u64) -> f64 {
    (at_ns - START_NS) as f64 * 1e-9
}

#[test]
fn a_thousand_pulses_with_jitter_are_a_thousand_volumes() {
    let scan = emulator(0.5, 0.008, TriggerFaults { jitter_s: 0.002, ..TriggerFaults::default() });
    let (pulses, detector) = detect(Line::default(), |time| scan.volts(time), 500.9);
    assert_eq!((pulses.len(), detector.pulses(), detector.glitches()), (1000, 1000, 0));
    for (volume, pulse) in (0..).zip(&pulses) {
        let truth = scan.pulse_start_s(volume).unwrap();
        assert!((seconds(pulse.at_ns) - truth).abs() <= 0.5e-3, "{volume}: {truth}");
    }
    let result = reconcile(times(&pulses), Series::new(0.5, Some(1000)));
    assert_eq!(result.counts, Counts { volumes: 1000, ..Counts::default() });
    let timing = result.timing.unwrap();
    assert!((timing.repetition_s - 0.5).abs() < 1e-6, "{}", timing.repetition_s);
    assert!((0.0018..0.0022).contains(&timing.jitter_s), "{}", timing.jitter_s);
}

#[test]
fn missing_and_spurious_pulses_are_told_and_the_volumes_reconciled() {
    let missing = vec![40, 41, 300, 777, 998];
    let spurious_s = vec![63.22, 200.37, 401.13];
    let faults = TriggerFaults { jitter_s: 0.001, missing, spurious_s, seed: 3 };
    let scan = emulator(0.5, 0.008, faults.clone());
    let (pulses, _) = detect(Line::default(), |time| scan.volts(time), 500.9);
    assert_eq!(pulses.len(), 1000 - 5 + 3);
    let result = reconcile(times(&pulses), Series::new(0.5, Some(1000)));
    let expected = Counts { volumes: 995, missed: 5, spurious: 3, ..Counts::default() };
    assert_eq!(result.counts, expected);
    assert_eq!(result.volumes.len(), 1000);
    for (found, truth) in result.spurious_ns.iter().zip(&faults.spurious_s) {
        assert!((seconds(*found) - truth).abs() <= 0.5e-3);
    }
    for (volume, found) in (0..).zip(&result.volumes) {
        assert_eq!(found.interpolated, faults.missing.contains(&volume), "{volume}");
        // An interpolated time is off by the jitter of its neighbours.
        let truth = scan.pulse_start_s(volume).unwrap_or(1.0 + 0.5 * volume as f64);
        assert!((seconds(found.at_ns) - truth).abs() <= 4e-3, "{volume}");
    }
}

#[test]
fn pulses_of_one_millisecond_are_all_found_at_two_kilohertz() {
    // The period is no multiple of the sampling time, so that every phase occurs.
    let scan = emulator(0.100_013, 0.001, TriggerFaults::default());
    let (pulses, detector) = detect(Line::default(), |time| scan.volts(time), 101.0);
    assert_eq!((pulses.len(), detector.glitches()), (1000, 0));
    // A single sample is a glitch.
    let (pulses, detector) =
        detect(Line::default(), |time| if time == 0.5 { 0.0 } else { 5.0 }, 1.0);
    assert_eq!((pulses.len(), detector.glitches()), (0, 1));
}

#[test]
fn lines_of_every_kind_and_polarity_are_read() {
    let scan = emulator(0.5, 0.008, TriggerFaults::default());
    let high = Line { active_low: false, threshold_v: 2.5, ..Line::default() };
    let (pulses, _) = detect(high, |time| 5.0 - scan.volts(time), 2.9);
    assert_eq!(pulses.len(), 4);

    // The level changes with every volume: at 0.5 s, 1 s, 1.5 s, …
    let toggled = |time: f64| if (time * 2.0).floor() as i64 % 2 == 0 { 5.0 } else { 0.0 };
    let (pulses, _) = detect(Line { kind: LineKind::Toggle, ..Line::default() }, toggled, 2.9);
    let found: Vec<_> = pulses.iter().map(|pulse| seconds(pulse.at_ns)).collect();
    assert_eq!(found.len(), 5);
    for (found, expected) in found.iter().zip([0.5, 1.0, 1.5, 2.0, 2.5]) {
        assert!((found - expected).abs() <= 0.5e-3);
    }

    let gate = |time: f64| if (1.0..2.0).contains(&time) { 0.0 } else { 5.0 };
    let (pulses, _) = detect(Line { kind: LineKind::Gate, ..Line::default() }, gate, 2.9);
    let kinds: Vec<_> = pulses.iter().map(|pulse| pulse.kind).collect();
    assert_eq!(kinds, [LineEventKind::Pulse, LineEventKind::GateEnd]);
    for (event, expected) in pulses.iter().zip([1.0, 2.0]) {
        assert!((seconds(event.at_ns) - expected).abs() <= 0.5e-3);
    }
}

#[test]
fn noise_within_the_band_and_a_pulse_in_progress_count_for_nothing() {
    // Within the band of 1.75 V to 2.25 V the line keeps its state.
    let hum = |time: f64| 2.0 + 0.2 * (6.0 * time).sin();
    let (pulses, detector) = detect(Line::default(), hum, 2.0);
    assert_eq!((pulses.len(), detector.glitches()), (0, 0));
    let (pulses, _) = detect(Line::default(), |time| if time < 0.1 { 0.0 } else { 5.0 }, 1.0);
    assert_eq!(pulses.len(), 0);
    let mut detector = PulseDetector::new(Line::default());
    assert_eq!(detector.observe(0, f64::NAN), None);
    assert_eq!(detector.observe(1, 5.0), None);
}

#[test]
fn an_edge_is_interpolated_between_two_samples() {
    let mut detector = PulseDetector::new(Line { hysteresis_v: 0.0, ..Line::default() });
    assert_eq!(detector.observe(0, 5.0), None);
    // From 5 V to 1 V: 2 V is passed after three quarters of the way.
    assert_eq!(detector.observe(SAMPLE_NS, 1.0), None);
    let expected = LineEvent { at_ns: 375_000, kind: LineEventKind::Pulse };
    assert_eq!(detector.observe(2 * SAMPLE_NS, 0.0), Some(expected));
}

#[test]
fn an_edge_within_a_gap_of_the_scans_is_not_interpolated() {
    let mut detector = PulseDetector::new(Line::default());
    detector.observe(0, 5.0);
    // 50 ms without a scan: the pulse may have begun a moment ago.
    assert_eq!(detector.observe(50_000_000, 0.0), None);
    let expected = LineEvent { at_ns: 50_000_000, kind: LineEventKind::Pulse };
    assert_eq!(detector.observe(50_500_000, 0.0), Some(expected));
}

#[test]
fn a_repetition_time_that_is_wrong_by_less_than_the_tolerance_is_learnt() {
    for wrong in [-0.045, -0.03, -0.01, 0.0, 0.01, 0.03, 0.045] {
        let repetition_s = 2.0 * (1.0 + wrong);
        let faults = TriggerFaults { jitter_s: 0.001, seed: 9, ..TriggerFaults::default() };
        let scan = emulator(repetition_s, 0.008, faults);
        let mut clock = VolumeClock::new(Series::new(2.0, None));
        for volume in 0..200 {
            clock.pulse(START_NS + (1e9 * scan.pulse_start_s(volume).unwrap()) as u64);
        }
        let expected = Counts { volumes: 200, ..Counts::default() };
        assert_eq!(clock.counts(), expected, "{wrong}");
        assert!((clock.repetition_s() - repetition_s).abs() < 1e-3, "{}", clock.repetition_s());
    }
    // Beyond the tolerance most pulses belong to no volume, and that is seen.
    let mut clock = VolumeClock::new(Series::new(2.0, None));
    for volume in 0..50 {
        clock.pulse(START_NS + 2_300_000_000 * volume);
    }
    assert!(clock.counts().spurious > 30, "{:?}", clock.counts());
}

#[test]
fn an_hour_of_another_clock_rate_is_followed_without_drift() {
    // The scanner's clock is slow by 80 ppm: 288 ms an hour.
    let repetition_s = 2.0 * (1.0 + 80e-6);
    let faults = TriggerFaults { jitter_s: 0.001, seed: 5, ..TriggerFaults::default() };
    let scan = emulator(repetition_s, 0.008, faults);
    let mut clock = VolumeClock::new(Series::new(2.0, None));
    let mut worst: f64 = 0.0;
    for volume in 0..1800 {
        let at_s = scan.pulse_start_s(volume).unwrap();
        clock.pulse(START_NS + (1e9 * at_s) as u64);
        let next = seconds(clock.time_ns((volume + 1) as f64).unwrap());
        if volume > 50 {
            worst = worst.max((next - (1.0 + (volume + 1) as f64 * repetition_s)).abs());
        }
    }
    assert!(worst < 0.002, "{worst}");
    assert!((clock.repetition_s() - repetition_s).abs() < 3e-4, "{}", clock.repetition_s());
    assert_eq!(clock.counts(), Counts { volumes: 1800, ..Counts::default() });
}

#[test]
fn a_spurious_first_pulse_and_a_second_start_are_told() {
    let mut clock = VolumeClock::new(Series::new(2.0, None));
    let mut pulse = |at_s: f64| clock.pulse(START_NS + (1e9 * at_s) as u64);
    assert_eq!(pulse(0.3), Counted::Volume { index: 0, missed: 0 });
    assert_eq!(pulse(1.0), Counted::Spurious);
    let first_ns = START_NS + 1_000_000_000;
    assert_eq!(pulse(3.0), Counted::Restarted { index: 1, first_ns });
    assert_eq!(pulse(5.0), Counted::Volume { index: 2, missed: 0 });
    let first = Counts { volumes: 3, spurious: 1, ..Counts::default() };
    // The operator stops the scan and starts it anew.
    assert_eq!(pulse(20.5), Counted::Spurious);
    let first_ns = START_NS + 20_500_000_000;
    assert_eq!(pulse(22.5), Counted::Restarted { index: 4, first_ns });
    assert_eq!(clock.counts(), Counts { volumes: 5, restarts: 1, ..first });
}

#[test]
fn a_reconciled_scan_keeps_the_pulses_of_a_second_start() {
    let pulses = [0.3, 1.0, 3.0, 5.0, 20.5, 22.5, 24.5];
    let times = pulses.map(|at_s| START_NS + (1e9 * at_s) as u64);
    let result = reconcile(times, Series::new(2.0, None));
    let found: Vec<u64> = result.volumes.iter().map(|volume| volume.at_ns).collect();
    assert_eq!(found, times[1..]);
    assert_eq!(result.spurious_ns, [times[0]]);
    assert_eq!((result.counts.restarts, result.timing), (1, None));
}

#[test]
fn a_pulse_closer_to_its_time_takes_the_place_of_one_further_off() {
    let mut clock = VolumeClock::new(Series::new(2.0, Some(3)));
    let mut pulse = |at_s: f64| clock.pulse(START_NS + (1e9 * at_s) as u64);
    pulse(0.0);
    assert_eq!(pulse(1.95), Counted::Volume { index: 1, missed: 0 });
    assert_eq!(pulse(2.0), Counted::Replaces { index: 1 });
    assert_eq!(pulse(4.0), Counted::Volume { index: 2, missed: 0 });
    assert_eq!(pulse(6.0), Counted::Surplus);
    let expected = Counts { volumes: 3, spurious: 1, surplus: 1, ..Counts::default() };
    assert_eq!(clock.counts(), expected);
}

#[test]
fn volumes_that_are_due_without_a_pulse_are_overdue() {
    let mut clock = VolumeClock::new(Series::new(2.0, Some(5)));
    let at = |seconds: f64| START_NS + (1e9 * seconds) as u64;
    assert_eq!((clock.overdue(at(50.0)), clock.volume_at(at(50.0))), (0, None));
    clock.pulse(at(0.0));
    assert_eq!(clock.overdue(at(2.05)), 0);
    assert_eq!(clock.overdue(at(2.2)), 1);
    assert_eq!(clock.overdue(at(5.0)), 2);
    assert_eq!(clock.overdue(at(500.0)), 4);
    assert_eq!(clock.volume_at(at(3.0)), Some(1.5));
}

proptest! {
    /// Whatever the scanner does short of a restart, no volume is numbered wrongly.
    #[test]
    fn volumes_keep_their_numbers(
        repetition_s in 0.2_f64..4.0,
        jitter in 0.0_f64..0.006,
        mut missing in prop::collection::vec(1_u64..199, 0..20),
        spurious in prop::collection::vec(0.25_f64..0.75, 0..5),
        seed: u64,
    ) {
        missing.sort_unstable();
        missing.dedup();
        // Spurious pulses between two volumes, out of reach of either.
        let spurious_s: Vec<f64> = spurious
            .iter()
            .zip(0..)
            .map(|(share, at)| 1.0 + repetition_s * (f64::from(at) * 37.0 + 5.0 + share))
            .collect();
        let faults = TriggerFaults {
            jitter_s: jitter * repetition_s,
            missing: missing.clone(),
            spurious_s: spurious_s.clone(),
            seed,
        };
        let scan = emulator(repetition_s, 0.002, faults);
        let mut pulses: Vec<f64> = (0..200).filter_map(|at| scan.pulse_start_s(at)).collect();
        pulses.extend(&spurious_s);
        pulses.sort_unstable_by(f64::total_cmp);
        let pulses = pulses.iter().map(|at| START_NS + (1e9 * at) as u64);
        let series = Series { tolerance_s: 0.09 * repetition_s, ..Series::new(repetition_s, None) };
        let result = reconcile(pulses, series);
        prop_assert_eq!(result.volumes.len(), 200);
        prop_assert_eq!(result.counts.missed, missing.len() as u64);
        prop_assert_eq!(result.counts.spurious, spurious_s.len() as u64);
        for (volume, found) in (0..).zip(&result.volumes) {
            prop_assert_eq!(found.interpolated, missing.contains(&volume));
        }
    }
}

//! The gradient artefact, and what is left of it and of the muscles' signal.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::f64::consts::TAU;

use emg::{
    ArtefactTemplate, Conditioner, Conditioning, Electrode, Group, InVolume, MuscleActivity,
    offline_artefact,
};
use ipc_types::ANALOG;
use plant::sensors::{Emg, EmgParameters};

const RATE_HZ: f64 = 2000.0;
const REPETITION_S: f64 = 2.0;

/// An artefact: 30 slices a volume, each a train of readouts, 20 times as large as the muscles'
/// signal; `since_s` from the volume's beginning.
fn artefact(since_s: f64) -> f64 {
    let slice = since_s.rem_euclid(REPETITION_S / 30.0);
    let shape = (TAU * 180.0 * slice).sin() + 0.5 * (TAU * 90.0 * slice).cos();
    if slice < 0.04 { 4.0 * shape * (std::f64::consts::PI * slice / 0.04).sin() } else { 0.0 }
}

/// Rms of what is left over the muscles' own signal after conditioning, in the last volumes, with
/// and without suppression. `drift` is the scanner's clock against the card's.
fn left(volumes: u32, drift: f64, full_rms_v: f64) -> (f64, f64, f64) {
    let parameters = EmgParameters { full_rms_v, ..EmgParameters::default() };
    let mut muscles = Emg::new(parameters, 1.0 / RATE_HZ, 7).unwrap();
    let mut template = ArtefactTemplate::new(volumes, RATE_HZ);
    let conditioner = Conditioner::new(&Conditioning::default(), RATE_HZ).unwrap();
    let [mut with, mut without, mut clean] = [conditioner; 3];
    let (mut suppressed, mut plain, mut signal) = (0.0, 0.0, 0.0);
    let period_s = REPETITION_S * (1.0 + drift);
    for k in 0..(60.0 * RATE_HZ) as u64 {
        let t = k as f64 / RATE_HZ + 0.00013;
        let since_s = t.rem_euclid(period_s);
        let muscle = muscles.read(1.5)[0];
        let raw = muscle + artefact(since_s);
        let own = clean.update(muscle).filtered;
        let kept = with.update(template.update(raw, since_s, REPETITION_S)).filtered - own;
        let polluted = without.update(raw).filtered - own;
        if t > 40.0 {
            suppressed += kept * kept;
            plain += polluted * polluted;
            signal += own * own;
        }
    }
    let root = |sum: f64| (sum / (20.0 * RATE_HZ)).sqrt();
    (root(suppressed), root(plain), root(signal))
}

#[test]
fn what_repeats_with_every_volume_is_taken_out() {
    // Without a muscle's signal, the artefact alone is left.
    let (suppressed, plain, _) = left(10, 0.0, 0.0);
    assert!(suppressed < plain / 300.0, "{suppressed} of {plain}");
    // A clock that is 80 ppm off moves the volumes against the samples.
    let (suppressed, plain, _) = left(10, 80e-6, 0.0);
    assert!(suppressed < plain / 30.0, "{suppressed} of {plain}");
}

#[test]
fn the_muscles_signal_stays() {
    // An average over ten volumes takes a tenth of the noise's power, and adds nothing else.
    let (suppressed, plain, signal) = left(10, 0.0, 0.2);
    assert!(plain > 10.0 * signal, "the artefact hides the signal: {plain}, {signal}");
    assert!(suppressed < 0.4 * signal, "{suppressed} of {signal}");
}

#[test]
fn nothing_is_subtracted_before_three_whole_volumes() {
    let mut template = ArtefactTemplate::new(10, RATE_HZ);
    // From the middle of a volume on: this one does not count.
    let mut k = 1000u64;
    let mut update = |template: &mut ArtefactTemplate| {
        let since_s = (k as f64 / RATE_HZ).rem_euclid(REPETITION_S);
        k += 1;
        template.update(1.0, since_s, REPETITION_S)
    };
    for _ in 0..3000 + 3 * 4000 {
        assert_eq!(update(&mut template), 1.0);
        assert!(!template.is_ready());
    }
    let after: Vec<f64> = (0..4000).map(|_| update(&mut template)).collect();
    assert!(template.is_ready() && after.iter().all(|value| value.abs() < 1e-12));
    template.clear();
    assert_eq!(update(&mut template), 1.0);
}

#[test]
fn a_volume_with_a_gap_does_not_count() {
    let mut template = ArtefactTemplate::new(10, RATE_HZ);
    let feed = |template: &mut ArtefactTemplate, left_out: std::ops::Range<u64>| {
        for k in (0..4000).filter(|k| !left_out.contains(k)) {
            let since_s = k as f64 / RATE_HZ;
            // In the gap, the artefact is another.
            let value = if (100..200).contains(&k) { 5.0 } else { 1.0 };
            template.update(value, since_s, REPETITION_S);
        }
    };
    feed(&mut template, 0..0);
    feed(&mut template, 100..200);
    feed(&mut template, 3990..4000);
    feed(&mut template, 0..2);
    feed(&mut template, 0..0);
    assert!(!template.is_ready(), "the first one alone, and this one is not yet at its end");
    feed(&mut template, 0..0);
    // Three were whole; the last of them ends with the first sample of the next.
    assert!(!template.is_ready());
    assert!((template.update(1.0, 0.0, REPETITION_S)).abs() < 1e-9);
    assert!(template.is_ready());
    for k in 1..4000 {
        let value = if (100..200).contains(&k) { 5.0 } else { 1.0 };
        let left = template.update(value, f64::from(k) / RATE_HZ, REPETITION_S);
        assert!(left.abs() < 1e-9, "{k}: {left}");
    }
    template.skip();
    assert!(template.is_ready(), "what was averaged is not forgotten");
}

#[test]
fn groups_are_means_over_their_electrodes() {
    let electrode = |input, per_v, group| Electrode { input, per_v, group };
    let electrodes = [
        electrode(1, 1.0, Group::Agonist),
        electrode(3, 2.0, Group::Agonist),
        electrode(2, 0.5, Group::Antagonist),
    ];
    let how = Conditioning { notch_hz: None, ..Conditioning::default() };
    let mut activity = MuscleActivity::new(&electrodes, &how, RATE_HZ).unwrap();
    let mut sums = [0.0; 2];
    for k in 0..8000 {
        let value = (TAU * 100.0 * f64::from(k) / RATE_HZ).sin();
        let mut analog_v = [f64::NAN; ANALOG];
        (analog_v[1], analog_v[2], analog_v[3]) = (value, value, -value);
        let found = activity.update(&analog_v, None).activity;
        if k >= 4000 {
            (sums[0], sums[1]) = (sums[0] + found[0], sums[1] + found[1]);
        }
    }
    let mean = 2.0 / std::f64::consts::PI;
    assert!((sums[0] / 4000.0 - 1.5 * mean).abs() < 0.01, "{sums:?}");
    assert!((sums[1] / 4000.0 - 0.5 * mean).abs() < 0.01, "{sums:?}");
    // A value that is not finite says so, and is forgotten at once.
    let found = activity.update(&[f64::NAN; ANALOG], None).activity;
    assert!(found.iter().all(|value| value.is_nan()));
    let found = activity.update(&[0.0; ANALOG], None).activity;
    assert!(found.iter().all(|value| value.is_finite()));
}

#[test]
fn activity_is_a_share_of_the_maxima_where_there_are_some() {
    let electrodes = [1, 3].map(|input| Electrode { input, per_v: 2.0, group: Group::Agonist });
    let how = Conditioning { notch_hz: None, ..Conditioning::default() };
    let mut plain = MuscleActivity::new(&electrodes, &how, RATE_HZ).unwrap();
    let mut shares = plain.clone();
    let mut maxima = [0.0; ANALOG];
    (maxima[1], maxima[3]) = (4.0, 0.5);
    shares.set_maxima(Some(&maxima));
    for k in 0..2000 {
        let mut analog_v = [0.0; ANALOG];
        analog_v[1] = (TAU * 100.0 * f64::from(k) / RATE_HZ).sin();
        analog_v[3] = (TAU * 70.0 * f64::from(k) / RATE_HZ).cos();
        let (plain, shares) = (plain.update(&analog_v, None), shares.update(&analog_v, None));
        let [one, other] = [1, 3].map(|input| plain.rectified[input]);
        assert_eq!(plain.activity, [(one + other) / 2.0, 0.0]);
        assert!((shares.activity[0] - (one / 4.0 + other / 0.5) / 2.0).abs() < 1e-12);
        assert_eq!((shares.rectified[1], shares.rectified[3]), (one, other));
        assert!(shares.rectified[0].is_nan());
    }
}

/// Rms of some values.
fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, n), value| (sum + value * value, n + 1.0));
    f64::sqrt(sum / count)
}

#[test]
fn a_recording_is_cleaned_from_both_sides() {
    // Ten seconds before the scan, 20 volumes of a scanner whose clock is off and whose pulses
    // jitter, and ten seconds after it.
    let period_s = REPETITION_S * (1.0 + 80e-6);
    let seconds = |k: usize| k as f64 / RATE_HZ + 0.00013;
    let begin_s = |volume: usize| 10.0 + volume as f64 * period_s;
    // Pulses are seen up to 0.02 ms late, where the artefact itself is regular.
    let seen_s = |volume: usize| begin_s(volume) + 2e-5 * (volume * 7 % 10) as f64 / 10.0;
    let mut muscles = Emg::new(EmgParameters::default(), 1.0 / RATE_HZ, 7).unwrap();
    let own: Vec<f64> = (0..120_000).map(|_| muscles.read(1.5)[0]).collect();
    let polluted: Vec<f64> = (0..own.len())
        .map(|k| {
            let inside = (begin_s(0)..begin_s(20)).contains(&seconds(k));
            let since_s = (seconds(k) - begin_s(0)).rem_euclid(period_s);
            own[k] + if inside { artefact(since_s) } else { 0.0 }
        })
        .collect();
    let places: Vec<Option<InVolume>> = (0..own.len())
        .map(|k| {
            let volume = (0..20).rev().find(|volume| seen_s(*volume) <= seconds(k))?;
            let since_s = seconds(k) - seen_s(volume);
            let until_s = seen_s(volume + 1) - seconds(k);
            (until_s > 0.0).then_some(InVolume { since_s, until_s })
        })
        .collect();
    let clean = |values: &[f64]| -> Vec<f64> {
        let found = offline_artefact(10, RATE_HZ, period_s, values, &places);
        values.iter().zip(found).map(|(value, own)| value - own.unwrap_or(0.0)).collect()
    };
    let cleaned = clean(&polluted);
    let error = |from_s: f64, to_s: f64| {
        let range = (from_s * RATE_HZ) as usize..(to_s * RATE_HZ) as usize;
        rms(range.map(|k| cleaned[k] - own[k]))
    };
    let signal = rms(own.iter().copied());
    let before = rms(polluted[40_000..80_000].iter().zip(&own[40_000..]).map(|(a, b)| a - b));
    assert!(before > 5.0 * signal, "{before} of {signal}");
    // In the first volume, where nothing came before, as in the middle and in the last one.
    for (from_s, to_s) in [(10.001, 12.0), (26.0, 34.0), (48.0, 49.9)] {
        let left = error(from_s, to_s);
        assert!(left < 0.5 * signal, "{left} of {signal} from {from_s} s");
    }
    // The middle has twice as many volumes: less of the muscles' noise is in their average.
    assert!(error(26.0, 34.0) < 0.35 * signal, "{} of {signal}", error(26.0, 34.0));
    assert_eq!(cleaned[..20_000], own[..20_000], "outside the scan nothing is changed");
    assert_eq!(cleaned[101_000..], own[101_000..]);
    let mut gap = polluted.clone();
    gap[60_000] = f64::NAN;
    let found = clean(&gap);
    assert!(found[60_000].is_nan() && found[60_001].is_finite());
}

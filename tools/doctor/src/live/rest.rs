//! What the rig shows at rest: the card's stream, the torque sensor's noise, the scanner's trigger.

use std::time::Duration;

use ipc_types::{CardKind, Sample};
use rig::Axis;
use runtime::Verdict;
use serde::Serialize;

use super::connection::{Observed, RunningRig};
use crate::bench::Bench;
use crate::outcome::{Outcome, at_most, worse};

/// A stream that is slower than the rig file's rate by more is not that of the card's clock.
const RATE_PASS: f64 = 0.01;
/// Beyond this samples are missing.
const RATE_WARN: f64 = 0.1;

/// What was found of the stream.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Stream {
    /// The card.
    card: Option<CardKind>,
    /// Samples per second (Hz).
    rate_hz: f64,
    /// Rate in the rig file (Hz).
    expected_hz: f64,
    /// Scans that the card dropped meanwhile.
    scans_missed: u64,
}

pub(crate) fn examine_card(bench: &mut Bench<'_>) -> anyhow::Result<Outcome> {
    let rig = bench.rig()?;
    let expected_hz = rig.file.as_ref().map_or(2000.0, |file| f64::from(file.rates.acquisition_hz));
    let found = stream(rig.observed()?, expected_hz);
    Ok(judge_card(&found).measured(&found))
}

fn stream(observed: &Observed, expected_hz: f64) -> Stream {
    let samples = &observed.samples;
    let (first, last) = (samples.first(), samples.last());
    let missed = |sample: Option<&Sample>| sample.map_or(0, |sample| sample.scans_missed);
    // By the ticks, so that the edges of the observation do not count.
    let span_s = first.zip(last).map_or(0.0, |(first, last)| {
        last.scan_time_ns.saturating_sub(first.scan_time_ns) as f64 * 1e-9
    });
    let rate_hz = match samples.len() {
        0 | 1 => 0.0,
        many => (many - 1) as f64 / span_s.max(observed.seconds / 2.0),
    };
    Stream {
        card: last.and_then(|sample| CardKind::from_code(sample.backend)),
        rate_hz,
        expected_hz,
        scans_missed: missed(last).saturating_sub(missed(first)),
    }
}

fn judge_card(found: &Stream) -> Outcome {
    let Stream { card, rate_hz, expected_hz, scans_missed } = found;
    let name = card.map_or("none", CardKind::text);
    let text =
        format!("card {name}, {rate_hz:.1} of {expected_hz} Hz, {scans_missed} scans missed");
    let short = (expected_hz - rate_hz).abs() / expected_hz;
    let by_rate = at_most(short, RATE_PASS, RATE_WARN);
    let by_misses = if *scans_missed > 0 { Verdict::Warn } else { Verdict::Pass };
    Outcome::new(worse(by_rate, by_misses), text)
}

/// The torque threshold of force control must be this many standard deviations of the noise: below,
/// noise alone switches the compensation of friction (eq. 4.2.3).
const NOISE_PASS: f64 = 5.0;
const NOISE_WARN: f64 = 2.0;
/// Mean torque at rest, as a share of the axis's limit, above which a hand or an offset is there.
const OFFSET_SHARE: f64 = 0.05;
/// Share of an input's range beyond which it is taken as saturated.
const SATURATED: f64 = 0.99;

/// What was found of one torque sensor at rest.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct TorqueNoise {
    axis: usize,
    /// Mean (N·m or N).
    mean: f64,
    /// Standard deviation at the input (V).
    noise_v: f64,
    /// Threshold of force control at the input (V); `None` without force control.
    threshold_v: Option<f64>,
    /// Limit of the torque (N·m or N).
    limit: Option<f64>,
    /// Largest reading, as a share of the input's range.
    range_share: f64,
    /// Whether every reading was a number.
    finite: bool,
}

pub(crate) fn examine_torque(bench: &mut Bench<'_>) -> anyhow::Result<Outcome> {
    let rig = bench.rig()?;
    let Some(file) = rig.file.clone() else { return Ok(no_file()) };
    let samples = &rig.observed()?.samples;
    let range_v = |channel| {
        file.channels.iter().find(|it| it.index == channel).map_or(10.0, |channel| channel.range_v)
    };
    let found: Vec<TorqueNoise> = file
        .axes
        .iter()
        .enumerate()
        .filter_map(|(axis, of)| {
            let range_v = range_v(of.torque?.channel);
            torque_noise(axis, of, range_v, samples)
        })
        .collect();
    if found.is_empty() {
        return Ok(Outcome::skipped("no axis has a torque sensor", "nothing to do"));
    }
    Ok(judge_torque(&found).measured(&found))
}

/// A rig that farreach's launcher did not start: its rig file is not known here.
pub(super) fn no_file() -> Outcome {
    Outcome::skipped(
        "the rig file of a rig that systemd started is not known here",
        "bring the rig up with `farreach up` once, and look again",
    )
}

fn torque_noise(axis: usize, of: &Axis, range_v: f64, samples: &[Sample]) -> Option<TorqueNoise> {
    let sensor = of.torque?;
    let present = samples.iter().filter(|sample| sample.torque_present & 1 << axis != 0);
    let torques: Vec<f64> = present.map(|sample| sample.slave_torque[axis]).collect();
    let count = torques.len().max(1) as f64;
    let mean = torques.iter().sum::<f64>() / count;
    let variance = torques.iter().map(|torque| (torque - mean).powi(2)).sum::<f64>() / count;
    let volts = torques.iter().map(|torque| sensor.volts(*torque).abs()).fold(0.0, f64::max);
    Some(TorqueNoise {
        axis,
        mean,
        noise_v: variance.sqrt() * sensor.volts_per_unit.abs(),
        threshold_v: of.control.force.as_ref().map(|force| force.torque_threshold_v),
        limit: of.limits.torque_max,
        range_share: volts / range_v,
        finite: !torques.is_empty() && torques.iter().all(|torque| torque.is_finite()),
    })
}

fn judge_torque(found: &[TorqueNoise]) -> Outcome {
    let mut verdict = Verdict::Pass;
    let mut words = Vec::new();
    let mut remedy = None;
    for sensor in found {
        let (its, advice) = judge_sensor(sensor);
        verdict = worse(verdict, its);
        remedy = remedy.or(advice);
        let TorqueNoise { axis, mean, noise_v, .. } = sensor;
        words.push(format!("axis {axis}: mean {mean:.3}, noise {:.2} mV", noise_v * 1e3));
    }
    let outcome = Outcome::new(verdict, words.join("; "));
    match remedy {
        Some(advice) => outcome.remedy(advice),
        None => outcome,
    }
}

fn judge_sensor(sensor: &TorqueNoise) -> (Verdict, Option<&'static str>) {
    let &TorqueNoise { mean, noise_v, threshold_v, limit, range_share, finite, .. } = sensor;
    if !finite {
        return (
            Verdict::Fail,
            Some("no reading: check the channel in the rig file and the cable"),
        );
    }
    if range_share >= SATURATED {
        return (Verdict::Fail, Some("the input is saturated: check the amplifier and its supply"));
    }
    if noise_v == 0.0 {
        return (Verdict::Warn, Some("every reading is the same: is the sensor connected?"));
    }
    let by_noise = threshold_v.map_or(Verdict::Pass, |threshold_v| {
        let ratio = threshold_v / noise_v;
        if ratio >= NOISE_PASS {
            Verdict::Pass
        } else if ratio >= NOISE_WARN {
            Verdict::Warn
        } else {
            Verdict::Fail
        }
    });
    let offset = limit.is_some_and(|limit| mean.abs() > OFFSET_SHARE * limit);
    match (by_noise, offset) {
        (Verdict::Pass, true) => {
            (Verdict::Warn, Some("nobody at the handle? then set `offset_v` in [axes.torque]"))
        }
        (Verdict::Pass, false) => (Verdict::Pass, None),
        (verdict, _) => (verdict, None),
    }
}

pub(crate) fn examine_trigger(bench: &mut Bench<'_>) -> anyhow::Result<Outcome> {
    let asked_s = bench.options.trigger_s;
    let rig = bench.rig()?;
    if rig.file.as_ref().is_some_and(|file| file.scanner.is_none()) {
        return Ok(Outcome::skipped("the rig file names no trigger line", "nothing to do"));
    }
    let Some(limit_s) = asked_s else {
        return Ok(Outcome::skipped(
            "no scanner was waited for",
            "start the scanner's pulses, then `farreach doctor --trigger 10`",
        ));
    };
    let pulses = wait(rig, limit_s)?;
    let verdict = if pulses > 0 { Verdict::Pass } else { Verdict::Fail };
    let text = match pulses {
        0 => format!("no pulse within {limit_s} s"),
        _ => format!("seen, {pulses} within {limit_s} s"),
    };
    Ok(Outcome::new(verdict, text).measured(&serde_json::json!({ "pulses": pulses })))
}

fn wait(rig: &RunningRig, limit_s: f64) -> anyhow::Result<u64> {
    rig.pulses(Duration::from_secs_f64(limit_s))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stream_has_the_rate_of_the_rig_file_and_misses_nothing() {
        let verdict = |rate_hz, scans_missed| {
            let card = Some(CardKind::Simulated);
            judge_card(&Stream { card, rate_hz, expected_hz: 2000.0, scans_missed }).verdict
        };
        assert_eq!(verdict(1980.0, 0), Verdict::Pass);
        assert_eq!(verdict(1979.0, 0), Verdict::Warn);
        assert_eq!(verdict(2000.0, 1), Verdict::Warn);
        assert_eq!(verdict(1800.0, 0), Verdict::Warn);
        assert_eq!(verdict(1799.0, 0), Verdict::Fail);
        assert_eq!(verdict(0.0, 0), Verdict::Fail);
    }

    #[test]
    fn the_rate_is_that_of_the_scans() {
        let sample = |at: u64| Sample { scan_time_ns: at * 500_000, ..Sample::default() };
        let observed =
            |count: u64| Observed { samples: (0..count).map(sample).collect(), seconds: 1.0 };
        assert!((stream(&observed(2001), 2000.0).rate_hz - 2000.0).abs() < 1e-9);
        assert_eq!(stream(&observed(1), 2000.0).rate_hz, 0.0);
        // Ten samples in a second are no stream of 2 kHz, however close together they were.
        assert!(stream(&observed(10), 2000.0).rate_hz < 20.0);
    }

    #[test]
    fn noise_is_held_against_the_threshold_of_force_control() {
        let sound = TorqueNoise {
            axis: 0,
            mean: 0.0,
            noise_v: 0.004,
            threshold_v: Some(0.02),
            limit: Some(12.0),
            range_share: 0.1,
            finite: true,
        };
        let verdict = |sensor: TorqueNoise| judge_torque(&[sensor]).verdict;
        assert_eq!(verdict(sound.clone()), Verdict::Pass);
        assert_eq!(verdict(TorqueNoise { noise_v: 0.0041, ..sound.clone() }), Verdict::Warn);
        assert_eq!(verdict(TorqueNoise { noise_v: 0.0101, ..sound.clone() }), Verdict::Fail);
        assert_eq!(verdict(TorqueNoise { noise_v: 0.0, ..sound.clone() }), Verdict::Warn);
        assert_eq!(verdict(TorqueNoise { mean: 0.6, ..sound.clone() }), Verdict::Pass);
        assert_eq!(verdict(TorqueNoise { mean: -0.61, ..sound.clone() }), Verdict::Warn);
        assert_eq!(verdict(TorqueNoise { range_share: 0.99, ..sound.clone() }), Verdict::Fail);
        assert_eq!(verdict(TorqueNoise { finite: false, ..sound.clone() }), Verdict::Fail);
        assert_eq!(verdict(TorqueNoise { threshold_v: None, ..sound }), Verdict::Pass);
    }

    #[test]
    fn noise_is_measured_at_the_input() {
        let rig = rig::load_rig(std::path::Path::new("hydrostatic")).unwrap();
        let sample = |at: usize| {
            let mut sample = Sample { torque_present: 1, ..Sample::default() };
            sample.slave_torque[0] = if at.is_multiple_of(2) { 0.104 } else { 0.096 };
            sample
        };
        let samples: Vec<Sample> = (0..100).map(sample).collect();
        let found = torque_noise(0, &rig.axes[0], 10.0, &samples).unwrap();
        assert!((found.mean - 0.1).abs() < 1e-12 && (found.noise_v - 0.002).abs() < 1e-12);
        assert_eq!((found.threshold_v, found.limit), (Some(0.02), Some(12.0)));
        assert!(!torque_noise(0, &rig.axes[0], 10.0, &[]).unwrap().finite);
    }
}

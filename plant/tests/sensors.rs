//! The instruments: torque cell, EMG, scanner trigger.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{DT_S, close};
use plant::ParameterSet;
use plant::sensors::{
    Drift, EMG_CHANNELS, Emg, EmgParameters, ScannerEmulator, ScannerTrigger, TorqueCell,
    TorqueCellParameters, TriggerFaults,
};
use proptest::prelude::*;
use std::f64::consts::TAU;

proptest! {
    /// Gain and offset bring the torque back from the voltage.
    #[test]
    fn torque_cell_readings_round_trip(
        volts_per_nm in 0.01_f64..10.0,
        offset_v in -1.0_f64..1.0,
        torque in -5.0_f64..5.0,
    ) {
        let parameters = TorqueCellParameters {
            volts_per_nm,
            offset_v,
            noise_v: 0.0,
            bandwidth_hz: f64::INFINITY,
            limit_v: 100.0,
        };
        let mut cell = TorqueCell::new(parameters, 1);
        let volts = cell.read(torque, 0.5e-3);
        let read = (volts - offset_v) / volts_per_nm;
        prop_assert!((read - torque).abs() <= 1e-12 * (1.0 + 1.0 / volts_per_nm));
    }
}

fn cell() -> TorqueCellParameters {
    TorqueCellParameters {
        volts_per_nm: 2.0,
        offset_v: 0.1,
        noise_v: 0.0,
        bandwidth_hz: f64::INFINITY,
        limit_v: 10.0,
    }
}

#[test]
fn torque_cell_drifts_as_declared() {
    let ramp = Drift { ramp_v_per_s: 0.02, ..Drift::default() };
    let mut ramping = TorqueCell::new(cell(), 1).with_drift(ramp);
    let mut last = 0.0;
    for _ in 0..20_000 {
        last = ramping.read(0.5, DT_S);
    }
    close(last, 1.1 + 0.02 * 10.0, 1e-9);
    // A random walk: the spread over many seeds grows with the root of time, whatever the step.
    for step in [0.01, 0.04] {
        for seconds in [1.0, 4.0] {
            let count = 2000;
            let square = (0..count).map(|seed| {
                let walk = Drift { walk_v_per_sqrt_s: 0.03, ..Drift::default() };
                let mut walking = TorqueCell::new(cell(), seed).with_drift(walk);
                let readings = (seconds / step) as usize;
                let end = (0..readings).map(|_| walking.read(0.0, step)).last().unwrap();
                assert_eq!(end, 0.1 + walking.wandered_v());
                walking.wandered_v().powi(2)
            });
            let spread = (square.sum::<f64>() / count as f64).sqrt();
            close(spread, 0.03 * f64::sqrt(seconds), 0.06);
        }
    }
    // Drift leaves the noise as it was, and clips with the rest.
    let noisy = TorqueCellParameters { noise_v: 0.01, ..cell() };
    let (mut plain, mut with) =
        (TorqueCell::new(noisy, 9), TorqueCell::new(noisy, 9).with_drift(ramp));
    for _ in 0..100 {
        let difference = with.read(0.0, DT_S) - plain.read(0.0, DT_S);
        assert!((difference - with.wandered_v()).abs() < 1e-12);
    }
    let mut far =
        TorqueCell::new(cell(), 1).with_drift(Drift { ramp_v_per_s: 1e3, ..Drift::default() });
    assert_eq!(far.read(0.0, 1.0), 10.0);
}

/// Readings of all channels under a constant torque, after the muscles have settled.
fn emg(
    parameters: EmgParameters,
    torque: f64,
    count: usize,
    seed: u64,
) -> Vec<[f64; EMG_CHANNELS]> {
    let mut emg = Emg::new(parameters, DT_S, seed).unwrap();
    for _ in 0..4000 {
        emg.read(torque);
    }
    (0..count).map(|_| emg.read(torque)).collect()
}

fn rms(readings: &[[f64; EMG_CHANNELS]], channel: usize) -> f64 {
    (readings.iter().map(|volts| volts[channel].powi(2)).sum::<f64>() / readings.len() as f64)
        .sqrt()
}

/// Power density over frequency bins: Hann windows of `length` samples, averaged.
fn spectrum(signal: &[f64], length: usize) -> Vec<f64> {
    let table: Vec<(f64, f64)> =
        (0..length).map(|index| (TAU * index as f64 / length as f64).sin_cos()).collect();
    let mut power = vec![0.0; length / 2];
    for part in signal.chunks_exact(length) {
        let windowed: Vec<f64> =
            part.iter().zip(&table).map(|(value, (_, cosine))| value * (1.0 - cosine)).collect();
        for (bin, power) in power.iter_mut().enumerate() {
            let (mut real, mut imaginary) = (0.0, 0.0);
            for (index, value) in windowed.iter().enumerate() {
                let (sine, cosine) = table[bin * index % length];
                (real, imaginary) = (real + value * cosine, imaginary + value * sine);
            }
            *power += real * real + imaginary * imaginary;
        }
    }
    power
}

#[test]
fn emg_lies_within_its_band() {
    let parameters = EmgParameters { floor_rms_v: 0.0, ..EmgParameters::default() };
    let signal: Vec<f64> = emg(parameters, 4.0, 100_000, 3).iter().map(|volts| volts[0]).collect();
    // Bins of 2 Hz.
    let power = spectrum(&signal, 1000);
    let total: f64 = power.iter().sum();
    let between = |low: usize, high: usize| power[low / 2..high / 2].iter().sum::<f64>();
    println!("within 10 to 400 Hz: {:.4}", between(10, 400) / total);
    // A Butterworth edge of fourth order leaves some beyond its 3 dB corner.
    assert!(between(10, 400) > 0.9 * total && between(8, 500) > 0.98 * total);
    assert!(between(0, 6) < 1e-3 * total && between(700, 1000) < 1e-3 * total);
    // Flat inside: the same density low and high.
    close(between(40, 140) / 100.0, between(200, 300) / 100.0, 0.06);
    // 3 dB at the upper corner.
    close(between(390, 410) / 20.0, 0.5 * between(100, 300) / 200.0, 0.12);
}

#[test]
fn emg_amplitude_is_proportional_to_activation() {
    let parameters = EmgParameters { floor_rms_v: 0.0, ..EmgParameters::default() };
    for (torque, part) in [(0.5, 0.1), (2.0, 0.4), (5.0, 1.0), (50.0, 1.0), (-2.0, 0.4)] {
        let readings = emg(parameters.clone(), torque, 60_000, 5);
        let agonist = usize::from(torque < 0.0);
        for channel in 0..EMG_CHANNELS {
            let excited = if channel % 2 == agonist {
                part
            } else {
                (torque.abs() / 5.0 * 0.15_f64).min(1.0)
            };
            close(rms(&readings, channel), 0.2 * excited, 0.025);
        }
    }
}

#[test]
fn emg_without_torque_is_the_noise_floor() {
    let readings = emg(EmgParameters::default(), 0.0, 60_000, 7);
    for channel in 0..EMG_CHANNELS {
        close(rms(&readings, channel), 0.003, 0.02);
    }
    // A stiffened joint is not silent, and pulls both ways alike.
    let stiff = EmgParameters { stiffening: 0.2, ..EmgParameters::default() };
    let readings = emg(stiff, 0.0, 60_000, 7);
    close(rms(&readings, 0), 0.04, 0.03);
    close(rms(&readings, 1), 0.04, 0.03);
}

#[test]
fn emg_channels_are_independent_and_seeded() {
    let readings = emg(EmgParameters::default(), 3.0, 60_000, 11);
    for one in 0..EMG_CHANNELS {
        for other in 0..one {
            let product: f64 =
                readings.iter().map(|volts| volts[one] * volts[other]).sum::<f64>() / 60_000.0;
            let correlation = product / (rms(&readings, one) * rms(&readings, other));
            assert!(correlation.abs() < 0.025, "{one} {other}: {correlation}");
        }
    }
    assert_eq!(readings, emg(EmgParameters::default(), 3.0, 60_000, 11));
    assert_ne!(readings[0], emg(EmgParameters::default(), 3.0, 1, 12)[0]);
}

#[test]
fn activation_follows_excitation() {
    let mut emg = Emg::new(EmgParameters::default(), DT_S, 1).unwrap();
    for _ in 0..30 {
        emg.read(2.5);
    }
    // One time constant of 15 ms up, then one of 50 ms down.
    let risen = 0.5 * (1.0 - (-1.0_f64).exp());
    close(emg.activation().0, risen, 1e-9);
    close(emg.activation().1, 0.15 * risen, 1e-9);
    for _ in 0..100 {
        emg.read(0.0);
    }
    close(emg.activation().0, risen * (-1.0_f64).exp(), 1e-9);
    assert!(emg.read(f64::NAN).iter().all(|volts| volts.is_finite()));
}

#[test]
fn emg_beyond_the_sampling_rate_is_refused() {
    let late = Emg::new(EmgParameters::default(), 2e-3, 1).unwrap_err();
    assert!(late.to_string().contains("high_hz"), "{late}");
}

#[test]
fn scanner_trigger_pulses_once_a_volume() {
    let trigger = ScannerTrigger { start_s: 1.0, volumes: 3.0, ..ScannerTrigger::default() }
        .checked()
        .unwrap();
    assert_eq!(
        [0.0, 0.999, 1.0, 2.999, 3.0, 6.999, 7.0].map(|time| trigger.volume(time)),
        [None, None, Some(0), Some(0), Some(1), Some(2), None]
    );
    // At 2 kHz, with times as a loop adds them up: 20 samples low in each of three pulses, each
    // begins on its sample.
    let (mut time, mut low, mut starts, mut before) = (0.0, 0, Vec::new(), false);
    for index in 0..20_000 {
        let pulse = trigger.pulse(time);
        assert_eq!(trigger.volts(time), if pulse { 0.0 } else { 5.0 });
        if pulse && !before {
            starts.push(index);
        }
        low += u32::from(pulse);
        before = pulse;
        time += DT_S;
    }
    assert_eq!((low, starts), (60, vec![2000, 6000, 10_000]));
    assert_eq!((trigger.volts(0.5), trigger.volts(1.0)), (5.0, 0.0));
    let long = ScannerTrigger { pulse_s: 2.0, ..ScannerTrigger::default() };
    assert!(long.checked().unwrap_err().to_string().contains("pulse_s"));
    assert!(ScannerTrigger::default().set("repetition_s", 0.0).is_err());
    assert_eq!(ScannerTrigger::default().volume(f64::NAN), None);
}

#[test]
fn an_emulated_scanner_without_faults_is_the_trigger_and_faults_are_as_asked() {
    // On the grid of 2 kHz some pulses begin with a sample: sums of steps are not exact.
    let trigger = ScannerTrigger {
        repetition_s: 0.0503,
        pulse_s: 0.001,
        start_s: 0.02,
        ..ScannerTrigger::default()
    };
    let perfect = ScannerEmulator { trigger, ..ScannerEmulator::default() }.checked().unwrap();
    for at in 0..20_000 {
        let time_s = f64::from(at) / 2000.0;
        assert_eq!(perfect.pulse(time_s), trigger.pulse(time_s), "{time_s}");
    }
    let faults = TriggerFaults {
        jitter_s: 0.002,
        missing: vec![7],
        spurious_s: vec![0.04],
        ..TriggerFaults::default()
    };
    let scanner = ScannerEmulator { trigger, faults }.checked().unwrap();
    assert!(scanner.pulse(0.0405) && !scanner.pulse(0.0415));
    assert_eq!(scanner.pulse_start_s(7), None);
    let off = |volume: u64| {
        scanner.pulse_start_s(volume).unwrap() - 0.02 - volume as f64 * trigger.repetition_s
    };
    let all: Vec<f64> = (8..1008).map(off).collect();
    let deviation = (all.iter().map(|off| off * off).sum::<f64>() / all.len() as f64).sqrt();
    assert!((0.0018..0.0022).contains(&deviation), "{deviation}");
    assert!(all.iter().all(|off| off.abs() <= 0.006 + 1e-12));
    let jitter_s = 1.01 * ScannerEmulator::jitter_limit_s(&trigger);
    let faults = TriggerFaults { jitter_s, ..TriggerFaults::default() };
    assert!(ScannerEmulator { trigger, faults }.checked().is_err());
}

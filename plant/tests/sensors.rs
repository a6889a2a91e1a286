//! The instruments: encoder, counter, speed, torque cell, EMG, scanner trigger.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{DT_S, close};
use plant::ParameterSet;
use plant::sensors::{
    Drift, EMG_CHANNELS, EdgePeriod, Emg, EmgParameters, Encoder, EncoderCounter,
    EncoderCounterParameters, FilteredDifference, Muscle, Phases, QuadratureDecoder,
    ScannerTrigger, TorqueCell, TorqueCellParameters, Unwrap,
};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::TAU;

proptest! {
    /// What an instrument makes of a quantity, its own inverse makes the quantity again, within
    /// what it must lose.
    #[test]
    fn encoder_positions_round_trip(
        counts_per_turn in 100.0_f64..1e5,
        backwards in any::<bool>(),
        position in -1e3_f64..1e3,
        volts_per_nm in 0.01_f64..10.0,
        offset_v in -1.0_f64..1.0,
        torque in -5.0_f64..5.0,
    ) {
        let encoder = Encoder::per_turn(if backwards { -counts_per_turn } else { counts_per_turn });
        let counts = encoder.counts(position);
        let half = 0.5 * std::f64::consts::TAU / counts_per_turn;
        prop_assert!((encoder.position(counts) - position).abs() <= half * (1.0 + 1e-9));
        prop_assert_eq!(encoder.counts(encoder.position(counts)), counts);
        let parameters = TorqueCellParameters {
            volts_per_nm,
            offset_v,
            noise_v: 0.0,
            bandwidth_hz: f64::INFINITY,
            limit_v: 100.0,
        };
        let mut cell = TorqueCell::new(parameters, 1);
        let volts = cell.read(torque, 0.5e-3);
        prop_assert!((cell.torque_nm(volts) - torque).abs() <= 1e-12 * (1.0 + 1.0 / volts_per_nm));
    }
}

#[test]
fn tracks_are_in_quadrature() {
    let levels = |counts: i64| {
        let phases = Phases::at(counts, 0);
        (phases.a, phases.b)
    };
    assert_eq!(
        [-4, -3, -2, -1, 0, 1, 2, 3].map(levels),
        [(false, false), (true, false), (true, true), (false, true)].repeat(2).as_slice()
    );
    assert!((-8000..8000).all(|counts| Phases::at(counts, 4000).index == (counts % 4000 == 0)));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 100, ..ProptestConfig::default() })]

    /// Edge by edge, decoder and counter card see the same movement.
    #[test]
    fn decoder_and_counter_agree(
        moves in prop::collection::vec(-900_i64..900, 1..12),
        at_zero in -500_i64..500,
    ) {
        let parameters = EncoderCounterParameters {
            counts_per_turn: 400.0,
            bits: 16.0,
            count_at_zero: at_zero as f64,
            ..EncoderCounterParameters::default()
        };
        let counter = || EncoderCounter::new(&parameters).unwrap();
        let (mut fine, mut coarse) = (counter(), counter());
        let encoder = fine.encoder();
        let mut counts = 0_i64;
        let mut decoder = QuadratureDecoder::new(at_zero, Phases::at(at_zero, 400));
        let mut unwrap = Unwrap::new(16);
        coarse.read(encoder.position(0));
        let mut fine_reading = fine.read(encoder.position(0));
        for travel in moves {
            for _ in 0..travel.abs() {
                counts += travel.signum();
                decoder.update(Phases::at(counts + at_zero, 400));
                fine_reading = fine.read(encoder.position(counts));
            }
            let reading = coarse.read(encoder.position(counts));
            prop_assert_eq!(unwrap.update(reading.raw), counts + at_zero);
            prop_assert_eq!(decoder.update(Phases::at(counts + at_zero, 400)), counts + at_zero);
            // What the card read in one go is what it saw edge by edge.
            prop_assert_eq!(reading, fine_reading);
            if let Some(latched) = decoder.index_at() {
                prop_assert_eq!(unwrap.nearby(reading.latched), latched);
                prop_assert_eq!(latched.rem_euclid(400), 0);
            } else {
                prop_assert_eq!(reading.latches, 0);
            }
        }
        prop_assert_eq!(decoder.missed(), 0);
    }

    #[test]
    fn wrap_is_undone(bits in 4_u32..=32, moves in prop::collection::vec(-1.0_f64..1.0, 1..60)) {
        let half = (1_i64 << (bits - 1)) - 1;
        let mask = (1_u64 << bits) - 1;
        let mut unwrap = Unwrap::new(bits);
        let mut counts = 0_i64;
        unwrap.update(0);
        for part in moves {
            counts += (part * half as f64) as i64;
            prop_assert_eq!(unwrap.update((counts as u64 & mask) as u32), counts);
        }
    }
}

#[test]
fn decoder_counts_missed_edges() {
    let mut decoder = QuadratureDecoder::new(0, Phases::at(0, 0));
    assert_eq!(decoder.update(Phases::at(2, 0)), 0);
    assert_eq!(decoder.missed(), 1);
    assert_eq!(decoder.update(Phases::at(3, 0)), 1);
}

#[test]
fn counter_wraps_latches_and_refuses_bad_parameters() {
    let parameters = EncoderCounterParameters {
        counts_per_turn: 100.0,
        bits: 8.0,
        ..EncoderCounterParameters::default()
    };
    let mut counter = EncoderCounter::new(&parameters).unwrap();
    let position = |counts: f64| (counts + 0.5) * TAU / 100.0;
    assert_eq!(counter.read(position(-1.0)).raw, 255);
    // Up over 0, 100 and 200: three latches, the last at 200; back into 200 is one more, out of it
    // none.
    let up = counter.read(position(257.0));
    assert_eq!((up.raw, up.latched, up.latches), (1, 200, 3));
    assert_eq!(counter.read(position(200.0)).latches, 4);
    assert_eq!(counter.read(position(199.0)).latches, 4);
    let back = counter.read(position(0.0));
    assert_eq!((back.raw, back.latched, back.latches), (0, 0, 6));
    // Where it is without end or number, it stays whole.
    assert_eq!(counter.read(f64::NAN), back);
    counter.read(f64::INFINITY);
    counter.read(f64::NEG_INFINITY);
    let reversed =
        EncoderCounterParameters { direction: -1.0, ..EncoderCounterParameters::default() };
    let mut counter = EncoderCounter::new(&reversed).unwrap();
    counter.read(0.0);
    assert_eq!(Unwrap::new(32).update(counter.read(-TAU).raw), 20_000);
    let wide = EncoderCounterParameters { bits: 40.0, ..EncoderCounterParameters::default() };
    assert!(EncoderCounter::new(&wide).unwrap_err().to_string().contains("bits"));
}

#[test]
fn filtered_difference_lags_as_documented() {
    for time_constant in [0.0, 1e-3, 8e-3, 0.1] {
        let mut estimate = FilteredDifference::new(DT_S, time_constant);
        // Ramp of speed: after the transient the estimate is the speed of `lag` ago.
        let (mut found, steps) = (0.0, 6000);
        for index in 0..=steps {
            let time = f64::from(index) * DT_S;
            found = estimate.update(0.5 * 3.0 * time * time).velocity;
        }
        let lag = estimate.lag_s();
        close(found, 3.0 * (f64::from(steps) * DT_S - lag), 1e-9);
        if time_constant == 0.0 {
            close(lag, 0.5 * DT_S, 1e-12);
        } else {
            close(lag, 0.5 * DT_S + DT_S / ((DT_S / time_constant).exp() - 1.0), 1e-12);
        }
        // Sine: gain and phase.
        let mut estimate = FilteredDifference::new(DT_S, time_constant);
        let frequency = TAU * 8.0;
        let (mut real, mut imaginary) = (0.0, 0.0);
        for index in 0..12_000 {
            let angle = frequency * f64::from(index) * DT_S;
            let velocity = estimate.update(angle.sin() / frequency).velocity;
            if index >= 8000 {
                // 4000 samples are 16 periods.
                real += velocity * angle.cos() / 2000.0;
                imaginary -= velocity * angle.sin() / 2000.0;
            }
        }
        let (gain, phase) = estimate.response(frequency);
        close(real.hypot(imaginary), gain, 1e-6);
        close(imaginary.atan2(real), phase, 1e-6);
        // At low frequency the phase is that of the lag.
        close(estimate.response(0.01).1, -0.01 * lag, 1e-4);
    }
}

#[test]
fn filtered_difference_has_the_documented_noise() {
    let mut estimate = FilteredDifference::new(1e-3, 5e-3);
    let gain = -(-0.2_f64).exp_m1();
    let mut generator = Pcg64Mcg::seed_from_u64(4);
    let (mut square, count) = (0.0, 200_000);
    for _ in 0..count {
        square +=
            estimate.update(1e-4 * generator.random::<f64>()).velocity.powi(2) / f64::from(count);
    }
    close(square.sqrt(), 0.1 * gain / (6.0 * (2.0 - gain)).sqrt(), 0.01);
}

#[test]
fn edge_period_lags_as_documented() {
    let encoder = Encoder::per_turn(4000.0);
    let pitch = TAU / 4000.0;
    // Constant speed, from far fewer to far more than an edge a reading, both ways: no error but
    // rounding.
    for speed in [0.05, -0.5, 3.0, -40.0] {
        let mut estimate = EdgePeriod::new(encoder, 1.0);
        let (mut least, mut most) = (f64::INFINITY, 0.0_f64);
        for index in 0..4000 {
            let time = f64::from(index) * DT_S;
            let found = estimate.update(speed * time + 0.3 * pitch, time);
            if index > 1000 {
                close(found.velocity, speed, 1e-6);
                (least, most) = (least.min(found.lag_s), most.max(found.lag_s));
            }
        }
        let period = pitch / f64::abs(speed);
        let (low, high) = if period < DT_S {
            (0.5 * DT_S, 0.5 * DT_S + period)
        } else {
            (0.5 * period, 1.5 * period)
        };
        assert!(
            least >= low * 0.999 && most <= high * 1.001,
            "{speed}: {least} {most}, {low} {high}"
        );
    }
    // Constant acceleration: the speed of `lag` ago. Edges are interpolated, so to second order in
    // the step.
    let mut estimate = EdgePeriod::new(encoder, 1.0);
    for index in 0..4000 {
        let time = f64::from(index) * DT_S;
        let found = estimate.update(5.0 * time * time, time);
        if index > 400 {
            close(found.velocity, 10.0 * (time - found.lag_s), 2e-3);
        }
    }
    // Left alone, the speed dies away as one pitch over the time, and then is none.
    let position = 5.0 * 2.0_f64.powi(2);
    let mut last = f64::INFINITY;
    for index in 0..4000 {
        let time = 2.0 + f64::from(index) * DT_S;
        let found = estimate.update(position, time).velocity;
        assert!(found <= last && found >= 0.0);
        if index > 20 {
            assert!(found <= 1.05 * pitch / (time - 2.0), "{found}");
        }
        last = found;
    }
    assert_eq!(last, 0.0);
}

#[test]
fn edge_period_reads_no_speed_from_a_jittering_edge() {
    let mut estimate = EdgePeriod::new(Encoder::per_turn(4000.0), 1.0);
    for index in 0..2000 {
        let position = if index % 2 == 0 { 1e-6 } else { -1e-6 };
        let found = estimate.update(position, f64::from(index) * DT_S);
        assert!(found.velocity.abs() < 1e-9, "{found:?}");
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
fn emg_electrodes_can_be_placed() {
    let mut placed = [(Muscle::Flexor, 1.0); EMG_CHANNELS];
    placed[5] = (Muscle::Extensor, 0.5);
    let parameters =
        EmgParameters { floor_rms_v: 0.0, cocontraction: 0.0, ..EmgParameters::default() };
    let mut emg = Emg::new(parameters.clone(), DT_S, 1).unwrap().with_channels(placed);
    let readings: Vec<_> = (0..20_000).map(|_| emg.read(-5.0)).collect();
    assert_eq!(rms(&readings, 1), 0.0);
    close(rms(&readings[1000..], 5), 0.1, 0.05);
    let late = Emg::new(parameters, 2e-3, 1).unwrap_err();
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
        let pulse = trigger.is_pulse(trigger.volts(time));
        assert_eq!(pulse, trigger.pulse(time));
        if pulse && !before {
            starts.push(index);
        }
        low += u32::from(pulse);
        before = pulse;
        time += DT_S;
    }
    assert_eq!((low, starts), (60, vec![2000, 6000, 10_000]));
    assert_eq!((trigger.volts(0.5), trigger.volts(1.0)), (5.0, 0.0));
    // A line that pulses high, and one whose levels lie both above 2.0 V.
    let high = ScannerTrigger { idle_v: 0.0, pulse_v: 5.0, ..ScannerTrigger::default() };
    assert!(high.is_pulse(3.3) && !high.is_pulse(1.0));
    let lifted = ScannerTrigger { idle_v: 10.0, pulse_v: 4.0, ..ScannerTrigger::default() };
    assert!(lifted.is_pulse(4.0) && !lifted.is_pulse(10.0));
    let long = ScannerTrigger { pulse_s: 2.0, ..ScannerTrigger::default() };
    assert!(long.checked().unwrap_err().to_string().contains("pulse_s"));
    assert!(ScannerTrigger::default().set("repetition_s", 0.0).is_err());
    assert_eq!(ScannerTrigger::default().volume(f64::NAN), None);
}

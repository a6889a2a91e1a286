//! Writes recordings of runs whose numbers are known.
#![allow(dead_code, unreachable_pub, clippy::unwrap_used, clippy::expect_used)]

use std::path::Path;

use ipc_types::{
    CARD_SCAN, COMMAND, CardScan, EnableToken, LoopTiming, LossCounters, Message as _,
    MotorCommand, Process, Profile, SAMPLE, Sample, TOKEN, TOPICS, WatchdogState, timing_topic,
};
use recording::mcap_write::{Start, Writer, key};

pub const MS: u64 = 1_000_000;
pub const PERIOD_NS: u64 = 500_000;
/// Tick of the first sample.
pub const FIRST_TICK: u64 = 2_000_000;
/// Time of the first scan.
pub const BEGIN_NS: u64 = FIRST_TICK * PERIOD_NS;

/// What happens in the run, in ms since its first scan.
///
/// Control dies at 500.3 (its last command is at 500), its successor begins at 600; the card is at
/// 0 V from 505.5 to 800. Acquisition dies at 1200.1, its successor begins at 1300.2 with the scans
/// that the FIFO kept; 0 V from 1213 to 1600. End at 2000.
#[derive(Clone, Copy, Debug, Default)]
pub struct Script {
    /// Samples that never reach the disk: from and to, in ticks since the first.
    pub lost: (u64, u64),
    /// Ticks that the card's FIFO dropped, in ticks since the first.
    pub missed: (u64, u64),
    /// The motor gets volts for one scan at this time although it must not, in ms; 0 for never.
    pub flicker_ms: u64,
    /// The successor of acquisition publishes its predecessor's last scan again.
    pub again: bool,
    /// Samples that the logger's own queue dropped at the very end: no gap in the file shows them.
    pub dropped_at_end: u64,
    /// The disk is full from this time on, in ms; 0 for never.
    pub full_at_ms: u64,
    /// No successor of control.
    pub control_stays_dead: bool,
}

pub const KILL_CONTROL_NS: u64 = BEGIN_NS + 500 * MS + 300_000;
pub const KILL_ACQUISITION_NS: u64 = BEGIN_NS + 1200 * MS + 100_000;

pub fn volts(ms: f64) -> f64 {
    2.0 + (ms * 0.006).sin()
}

/// Whether the motor has volts at that scan.
fn powered(ms: f64) -> bool {
    (100.0..505.5).contains(&ms) || (800.5..1213.0).contains(&ms) || ms >= 1600.5
}

pub fn write(path: &Path, script: Script) {
    let start = Start { realtime_offset_ns: 1_700_000_000_000_000_000, ..Start::default() }
        .with(key::RIG, "hydrostatic")
        .with(key::REVISION, "0123abcd");
    let mut writer = Writer::create(path, &start, BEGIN_NS).unwrap();
    let (mut sample_sequence, mut command_sequence) = (0, 0);
    for index in 0..4000u64 {
        let ms = index as f64 * 0.5;
        if script.full_at_ms > 0 && index == 2 * script.full_at_ms {
            return;
        }
        let scan_ns = BEGIN_NS + index * PERIOD_NS;
        let mut motor = if powered(ms) { volts(ms) } else { 0.0 };
        if script.flicker_ms > 0 && index == 2 * script.flicker_ms {
            motor = 1.0;
        }
        scan(&mut writer, index, scan_ns, motor);
        if index % 2 == 0 {
            token(&mut writer, index / 2, scan_ns + 350_000);
        }
        // acquisition: 80 µs after the scan; the successor's first 200 scans come at once
        let second = ms > 1200.0;
        if index == 2401 {
            sample_sequence = 0;
            if script.again {
                sample(&mut writer, 2, &mut sample_sequence, 2400, 1_300_200_000, script);
            }
        }
        if !(script.missed.0..script.missed.1).contains(&index) {
            let published = if second {
                (index * PERIOD_NS + 80_000).max(1_300_200_000)
            } else {
                index * PERIOD_NS + 80_000
            };
            sample(
                &mut writer,
                if second { 2 } else { 1 },
                &mut sample_sequence,
                index,
                published,
                script,
            );
        }
        // control: 500 Hz, 200 µs after every fourth scan, answers the scan before
        if index % 4 == 0 && index > 0 {
            let (incarnation, runs) = if ms <= 500.0 { (11, true) } else { (12, ms >= 600.0) };
            if ms == 600.0 {
                command_sequence = 0;
            }
            // while acquisition is dead it answers the last sample again and again
            let answered = if (1200.0..1302.0).contains(&ms) { 2400 } else { index };
            if runs && !(incarnation == 12 && script.control_stays_dead) {
                command(
                    &mut writer,
                    incarnation,
                    &mut command_sequence,
                    answered,
                    scan_ns + 200_000,
                    ms,
                );
            }
        }
        writer.tick(scan_ns).unwrap();
    }
    timings(&mut writer);
    let topic = TOPICS.iter().position(|topic| topic.name == SAMPLE.topic.name).unwrap() as u32;
    let counters =
        LossCounters { topic, dropped: script.dropped_at_end, ..LossCounters::default() };
    writer.finish(&[counters]).unwrap();
}

fn timings(writer: &mut Writer) {
    for (process, incarnation, missed, late) in [
        (Process::Acquisition, 1, 1, [10_000, 20_000, 30_000, 40_000]),
        (Process::Acquisition, 2, 2, [5_000, 25_000, 26_000, 90_000]),
        (Process::Control, 11, 0, [11_000, 12_000, 13_000, 14_000]),
    ] {
        // an earlier message of the same incarnation must not count
        for (sequence, scale) in [(0, 100), (1, 1)] {
            let mut timing = LoopTiming {
                missed_periods: missed,
                total_wake_late_ns: late.map(|ns: u64| ns * scale),
                source: process.code(),
                profile: Profile::Realtime.code(),
                ..LoopTiming::default()
            };
            timing.stamp(7, incarnation, sequence, BEGIN_NS + 1990 * MS + sequence);
            writer.write_message(&timing_topic(process).unwrap(), &timing).unwrap();
        }
    }
}

fn scan(writer: &mut Writer, index: u64, scan_ns: u64, motor: f64) {
    let ms = index as f64 * 0.5;
    let mut scan = CardScan {
        tick: FIRST_TICK + index,
        scan_time_ns: scan_ns,
        profile: 0,
        ..CardScan::default()
    };
    scan.motor_v[0] = motor;
    // the DAC holds while acquisition is dead
    scan.dac_v[0] = if (1200.0..1300.0).contains(&ms) { volts(1200.0) } else { motor };
    scan.stamp(7, 21, index, scan_ns + 5_000);
    writer.write_message(&CARD_SCAN, &scan).unwrap();
}

fn token(writer: &mut Writer, sequence: u64, time_ns: u64) {
    let ms = (time_ns - BEGIN_NS) as f64 * 1e-6;
    let (epoch, state) = match ms {
        _ if ms < 100.0 => (0, WatchdogState::Armed),
        _ if ms < 508.0 => (1, WatchdogState::Enabled),
        _ if ms < 750.0 => (1, WatchdogState::Tripped),
        _ if ms < 800.0 => (1, WatchdogState::Armed),
        _ if ms < 1208.0 => (2, WatchdogState::Enabled),
        _ if ms < 1600.0 => (2, WatchdogState::Tripped),
        _ => (3, WatchdogState::Enabled),
    };
    let enabled = u8::from(state == WatchdogState::Enabled);
    let mut token =
        EnableToken { epoch, enabled, state: state.code(), cause: 4, ..EnableToken::default() };
    token.stamp(7, 31, sequence, time_ns);
    writer.write_message(&TOKEN, &token).unwrap();
}

fn sample(
    writer: &mut Writer,
    incarnation: u64,
    sequence: &mut u64,
    index: u64,
    since_ns: u64,
    script: Script,
) {
    let ms = index as f64 * 0.5;
    let own = *sequence;
    *sequence += 1;
    if (script.lost.0..script.lost.1).contains(&index) {
        return;
    }
    let mut sample = Sample {
        tick: FIRST_TICK + index,
        scan_time_ns: BEGIN_NS + index * PERIOD_NS,
        master_present: 1,
        slave_present: 1,
        torque_present: 1,
        motor_present: 1,
        axes: 1,
        gate_state: u8::from(powered(ms)),
        cycles_missed: if incarnation == 2 { 5 } else { 0 },
        ..Sample::default()
    };
    sample.motor_v[0] = if powered(ms) { volts(ms) } else { 0.0 };
    let moved = ((ms - 100.0).max(0.0) * 0.006).sin();
    sample.master_position[0] = 0.3 * moved;
    sample.slave_position[0] = 0.2 * moved;
    sample.stamp(7, incarnation, own, BEGIN_NS + since_ns);
    writer.write_message(&SAMPLE, &sample).unwrap();
}

fn command(
    writer: &mut Writer,
    incarnation: u64,
    sequence: &mut u64,
    index: u64,
    time_ns: u64,
    ms: f64,
) {
    let mut command = MotorCommand {
        sample_tick: FIRST_TICK + index,
        sample_time_ns: BEGIN_NS + index * PERIOD_NS,
        ..MotorCommand::default()
    };
    command.volts[0] = volts(ms);
    command.reference_position[0] = 0.3 * (ms * 0.006).sin();
    command.stamp(7, incarnation, *sequence, time_ns);
    *sequence += 1;
    writer.write_message(&COMMAND, &command).unwrap();
}

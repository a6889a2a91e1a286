//! The comedi card, on the kernel's own drivers: `comedi_test` (waveforms, analog outputs) and
//! `comedi_parport` (digital lines). `.ci/comedi_qemu.py` runs these tests in a virtual machine;
//! elsewhere they skip themselves, since they need both drivers, root, and one thread.
#![allow(clippy::unwrap_used)]

mod conformance;
mod guest;

use std::io::{BufRead, BufReader, Write};
use std::process::{Command, Stdio};

use acquisition::Converter;
use acquisition::homing::Homing;
use comedi::{Device, Errno, OutputLine, channel_spec};
use ipc_types::CardKind;
use rig::Rates;
use runtime::daq::{Daq, DaqError, Scan};

use conformance::Bench;
use guest::{ComediBench, Encoders, RIG, allocations, checked, is_guest, rig, start, stream, wait};

/// Channels that neither waveform is on show the code 0x7fff.
const FLAT_V: f64 = -0.5 * 20.0 / 65_535.0;

fn ticks_without_hole(scans: &[Scan]) {
    for pair in scans.windows(2) {
        assert_eq!(pair[1].tick, pair[0].tick + 1);
        assert!(pair[1].time_ns > pair[0].time_ns);
    }
}

/// By how much the time of a scan is later than when it was taken (ns), which the sawtooth in it
/// tells: its period is 0.1 s, a code is 1.5 µs.
fn late_ns(scan: &Scan) -> i64 {
    const PERIOD_NS: f64 = 1e8;
    let code = (scan.analog_v[0] + 10.0) / 20.0 * 65_535.0;
    let phase_ns = code / 65_534.0 * PERIOD_NS;
    let told_ns = (scan.time_ns % PERIOD_NS as u64) as f64;
    let late = (told_ns - phase_ns).rem_euclid(PERIOD_NS);
    (if late > 0.5 * PERIOD_NS { late - PERIOD_NS } else { late }) as i64
}

#[test]
fn the_card_conforms() {
    if !is_guest() {
        return;
    }
    // Slower than a rig file may have it for a real card, which could not be armed.
    let mut slow = rig(RIG);
    slow.rates =
        Rates { acquisition_hz: 100, control_hz: 100, watchdog_hz: 100, experiment_hz: 100 };
    let mut bench = ComediBench::new(slow);
    assert_eq!(bench.daq().kind(), CardKind::Comedi);
    assert_eq!(bench.daq().capabilities(), CardKind::Comedi.capabilities());
    conformance::check(&mut bench).unwrap();
}

/// 60 s of 8 channels at 2 kHz, with an output that follows a ramp.
#[test]
fn a_minute_has_no_hole_and_each_scan_its_time() {
    if !is_guest() {
        return;
    }
    let encoders = Encoders::open();
    encoders.show(0x8000, 0x8000);
    let mut daq = start(RIG, None);
    let mut scans = 0u64;
    let (mut last, mut volts) = (None::<Scan>, -5.0);
    let (mut least_late, mut most_late) = (i64::MAX, i64::MIN);
    while scans < 120_000 {
        volts = if volts >= 5.0 { -5.0 } else { volts + 0.01 };
        let before = allocations();
        let written = daq.write([volts, 0.0, 0.0]);
        let read = daq.read_due(0);
        assert_eq!(allocations(), before, "a cycle allocates nothing");
        written.unwrap();
        for scan in read.unwrap() {
            if let Some(last) = last {
                assert_eq!(scan.tick, last.tick + 1, "after {scans} scans");
                assert!(scan.time_ns > last.time_ns);
            }
            assert!(scan.analog_v[2..8].iter().all(|v| (v - FLAT_V).abs() < 1e-9));
            assert_eq!(scan.analog_v[1] > 0.0, scan.analog_v[0] > FLAT_V - 1e-9, "in phase");
            // The first second finds the offset of the clock.
            if scans > 2_000 {
                least_late = least_late.min(late_ns(scan));
                most_late = most_late.max(late_ns(scan));
            }
            assert_eq!((scan.present.analog, scan.master_counts[0]), (0xff, 0));
            (last, scans) = (Some(*scan), scans + 1);
        }
        if scans % 1_000 < 8 {
            let [found, ..] = daq.held_v().unwrap();
            assert!((found - volts).abs() <= 0.51 * daq.resolution_v(), "{found} {volts}");
        }
        wait(1);
    }
    assert_eq!(daq.scans_missed(), 0);
    println!(
        "MEASURED {scans} scans without a hole; their times are late by {least_late} ns to \
         {most_late} ns"
    );
    assert!(least_late > -100_000, "a scan was told {} ns before it was taken", -least_late);
    assert!(most_late < 5_000_000, "a scan was told {most_late} ns late");
}

#[test]
fn an_overrun_is_a_hole_that_is_counted_once() {
    if !is_guest() {
        return;
    }
    let mut daq = start(RIG, None);
    let mut seen = stream(&mut daq, 400);
    // The kernel's buffer has 512 scans: a quarter of a second.
    wait(800);
    let before = daq.scans_missed();
    assert_eq!(before, 0);
    seen.extend(daq.read_due(0).unwrap());
    seen.extend(daq.read_due(0).unwrap());
    seen.extend(stream(&mut daq, 400));
    let span = seen.last().unwrap().tick - seen[0].tick + 1;
    let holes: Vec<u64> = seen
        .windows(2)
        .map(|pair| pair[1].tick - pair[0].tick - 1)
        .filter(|missing| *missing > 0)
        .collect();
    assert_eq!(holes.len(), 1, "{holes:?}");
    assert_eq!(daq.scans_missed(), span - seen.len() as u64);
    assert_eq!(daq.scans_missed(), holes[0]);
    // About half a second was lost; each scan tells when it was taken, so the hole has that length.
    assert!((700..100_000).contains(&holes[0]), "{holes:?}");
}

#[test]
fn volts_come_back_within_half_a_step_and_hold_while_nobody_is_there() {
    if !is_guest() {
        return;
    }
    let mut daq = start(RIG, None);
    for step in -20..=20 {
        let volts = 0.5 * f64::from(step);
        daq.write([volts, 0.0, 0.0]).unwrap();
        let [found, ..] = daq.held_v().unwrap();
        assert!((found - volts).abs() <= 0.5001 * daq.resolution_v(), "{volts}: {found}");
    }
    assert_eq!(daq.write([1.0, 1.0, 0.0]), Err(DaqError::NoOutput));
    let other = Device::open("/dev/comedi2").unwrap();
    let channel = channel_spec(0, 0, 0);
    assert_eq!(other.write(1, channel, 0), Err(Errno::ACCESS), "another process is kept out");
    drop(daq);
    // On this driver an input reads what the output of its number puts out.
    assert_eq!(other.read(0, channel), Ok(0xffff));
}

#[test]
fn counters_are_followed_round_their_end_and_through_a_restart() {
    if !is_guest() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let encoders = Encoders::open();
    encoders.show(0x8000, 0x7fff);
    let mut daq = start(RIG, Some(folder.path()));
    let first = *stream(&mut daq, 20).last().unwrap();
    assert_eq!((first.master_counts[0], first.slave_counts[0]), (0, -1));
    let mut shown = 0x8000u32;
    for _ in 0..6 {
        shown += 0x3000;
        encoders.show(shown & 0xffff, 0x7fff);
        let scans = stream(&mut daq, 20);
        ticks_without_hole(&scans);
        let counts: Vec<i64> = scans.iter().map(|scan| scan.master_counts[0]).collect();
        assert!(counts.is_sorted(), "{counts:?}");
        assert_eq!(*counts.last().unwrap(), i64::from(shown) - 0x8000);
    }
    encoders.show(0x8100, 0x7fff);
    stream(&mut daq, 20);
    drop(daq);
    let mut daq = start(RIG, Some(folder.path()));
    let again = *stream(&mut daq, 20).last().unwrap();
    assert_eq!((again.master_counts[0], again.slave_counts[0]), (0x100, -1));
    assert_eq!(again.power_up, first.power_up);
    drop(daq);
    let other = RIG.replace("channel = 1, mode", "channel = 2, mode");
    let mut daq = start(&other, Some(folder.path()));
    assert_ne!(stream(&mut daq, 20)[0].power_up, first.power_up);
}

#[test]
fn digital_lines_show_and_are_shared() {
    if !is_guest() {
        return;
    }
    let mut daq = start(RIG, None);
    daq.write_digital(0b1010_0101).unwrap();
    assert_eq!(daq.write_digital(0x100), Err(DaqError::NoOutput));
    let parport = Device::open("/dev/comedi0").unwrap();
    assert_eq!(parport.bits(0, 0, 0).unwrap(), 0b1010_0101);
    // QEMU's port: without strobe, init and select, nothing acknowledges.
    let line = OutputLine::open("/dev/comedi0", "test", 2, 0).unwrap();
    let levels = |daq: &mut acquisition::ComediDaq| {
        let scan = *stream(daq, 20).last().unwrap();
        (scan.digital_out, scan.digital_in, scan.motor_power)
    };
    parport.bits(2, 0b1111, 0).unwrap();
    let idle = levels(&mut daq);
    parport.bits(2, 0b1110, 0b1100).unwrap();
    line.set(true).unwrap();
    let acknowledged = levels(&mut daq);
    println!("MEASURED digital inputs {idle:x?}, then {acknowledged:x?}");
    assert_eq!(idle.0, 0b1010_0101);
    // Bit 4 is the input that sees the motor's power, active low.
    assert_eq!((idle.2, acknowledged.2), (false, true));
    assert!(line.level().unwrap());
    line.set(false).unwrap();
    assert_eq!(parport.bits(2, 0, 0).unwrap(), 0b1100);
}

/// The rig without outputs and inputs, with a force cell, and with more keys for its axis.
fn measured(keys: &str) -> String {
    let lines = RIG.find("[comedi.enable_line]").unwrap()..RIG.find("[comedi.digital.out").unwrap();
    let text = RIG.replace(&RIG[lines], "").replace("output_channel = 0", keys);
    let cell = "[axes.torque]\nchannel = 2\nvolts_per_n = 0.1\n\n[axes.limits]\nforce_max_n = 50.0";
    let text = text.replace("[axes.limits]", cell);
    text.replace("name = \"flat_2\"\nkind = \"other\"", "name = \"flat_2\"\nkind = \"torque\"")
}

/// The fault line of each sensor in turn, at the input of the port that answers to its outputs.
#[test]
fn a_fault_line_takes_its_sensor_away_for_as_long_as_it_is_active() {
    if !is_guest() {
        return;
    }
    let encoders = Encoders::open();
    encoders.show(0x8000 + 1234, 0x8000 - 77);
    let parport = Device::open("/dev/comedi0").unwrap();
    // With strobe, init and select QEMU's port acknowledges: line 4 goes low.
    let set_fault = |is_there: bool| {
        let levels: &[u32] = if is_there { &[0b1100, 0b1101] } else { &[0] };
        for &levels in levels {
            parport.bits(2, 0b1111, levels).unwrap();
        }
    };
    for (key, left) in
        [("master_fault", (0, 1, 1)), ("slave_fault", (1, 0, 1)), ("torque_fault", (1, 1, 0))]
    {
        let line = "{ device = \"/dev/comedi0\", subdevice = 1, channel = 4, active = \"low\" }";
        let text = measured(&format!("{key} = {line}"));
        let rig = rig(&text);
        let (converter, homing) = (Converter::new(&rig), Homing::absolute(&rig));
        set_fault(false);
        let mut daq = start(&text, None);
        for is_there in [false, true, false] {
            set_fault(is_there);
            let scans = stream(&mut daq, 40);
            ticks_without_hole(&scans);
            let sample = converter.convert(scans.last().unwrap(), homing.zeros());
            let found = (sample.master_present, sample.slave_present, sample.torque_present);
            assert_eq!(found, if is_there { left } else { (1, 1, 1) }, "{key}: {is_there}");
            // What the counter says is recorded nevertheless, and counts on from there.
            assert_eq!((sample.master_counts[0], sample.slave_counts[0]), (1234, -77));
            let before = allocations();
            let read = daq.read_due(0);
            assert_eq!(allocations(), before, "a cycle allocates nothing");
            read.unwrap();
        }
    }
}

#[test]
fn a_card_that_is_not_what_the_rig_file_says_is_refused() {
    if !is_guest() {
        return;
    }
    for (from, to, expected) in [
        (
            "driver = \"comedi_test\"",
            "driver = \"ni_pcimio\"",
            "comedi.driver: expected the driver",
        ),
        ("device = \"/dev/comedi2\"", "device = \"/dev/comedi9\"", "load the card's comedi driver"),
        (
            "driver = \"comedi_test\"",
            "input = 1",
            "comedi.input: expected a subdevice with analog inputs, found subdevice 1 with analog \
             outputs",
        ),
        (
            "output_channel = 0",
            "output_channel = 8",
            "comedi.axes.0.output.channel: expected a channel below 8, found 8",
        ),
        (
            "[comedi.enable_line]\ndevice = \"/dev/comedi0\"\nsubdevice = 2\nchannel = 0",
            "[comedi.enable_line]\ndevice = \"/dev/comedi2\"\nsubdevice = 0\nchannel = 0",
            "comedi.enable_line: expected a subdevice with digital outputs",
        ),
        (
            "output_channel = 0",
            "output_channel = 0\nmaster_fault = { subdevice = 0, channel = 1 }",
            "comedi.axes.0.master_fault: expected a subdevice with digital inputs",
        ),
        (
            "channel = 0, mode = \"none\"",
            "channel = 0, mode = \"s626\"",
            "comedi.axes.0.master: expected a subdevice with counters",
        ),
    ] {
        assert_eq!(RIG.matches(from).count(), 1, "{from}");
        let error = checked(&RIG.replace(from, to)).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
}

/// Runs as a process of its own for the next test: streams and holds volts until it is killed.
#[test]
fn acquisition_of_its_own() {
    let Some(folder) = std::env::var_os("FARREACH_COMEDI_FOLDER") else { return };
    let mut daq = start(RIG, Some(folder.as_ref()));
    loop {
        daq.write([3.0, 0.0, 0.0]).unwrap();
        let scans = daq.read_due(0).unwrap().to_vec();
        ticks_without_hole(&scans);
        if let Some(scan) = scans.last() {
            assert_eq!(daq.scans_missed(), 0);
            let (tick, time, power_up) = (scan.tick, scan.time_ns, scan.power_up);
            println!("\nSCAN {tick} {time} {power_up} {}", scan.master_counts[0]);
            std::io::stdout().flush().unwrap();
        }
        wait(2);
    }
}

#[test]
fn a_second_process_is_kept_out_and_then_goes_on() {
    if !is_guest() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let encoders = Encoders::open();
    encoders.show(0x8000 + 1234, 0x8000);
    let mut first = Command::new(std::env::current_exe().unwrap())
        .args(["acquisition_of_its_own", "--exact", "--nocapture"])
        .env("FARREACH_COMEDI_FOLDER", folder.path())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(first.stdout.take().unwrap()).lines();
    let mut next = || {
        let line = lines.by_ref().map(Result::unwrap).find(|line| line.starts_with("SCAN "));
        let words = line.unwrap();
        let number = |at: usize| words.split(' ').nth(at).unwrap().parse::<u64>().unwrap();
        [number(1), number(2), number(3), number(4)]
    };
    for _ in 0..500 {
        next();
    }
    let refused = checked(RIG).unwrap().start(Some(folder.path())).unwrap_err().to_string();
    assert!(refused.contains("another process"), "{refused}");
    let mut last = [0; 4];
    for _ in 0..500 {
        last = next();
    }
    first.kill().unwrap();
    first.wait().unwrap();
    // What it had printed until its end.
    for line in lines.map_while(Result::ok).filter(|line| line.starts_with("SCAN ")) {
        let numbers: Vec<u64> = line.split(' ').skip(1).map_while(|n| n.parse().ok()).collect();
        last = numbers.try_into().unwrap_or(last);
    }
    let watching = Device::open("/dev/comedi2").unwrap();
    let held = f64::from(watching.read(0, channel_spec(0, 0, 0)).unwrap()) / 65_535.0 * 20.0 - 10.0;
    assert!((held - 3.0).abs() < 2e-4, "outputs hold: {held}");
    let mut daq = start(RIG, Some(folder.path()));
    let scans = stream(&mut daq, 2_000);
    ticks_without_hole(&scans);
    let scan = scans[0];
    assert!(scan.tick > last[0] && scan.time_ns > last[1]);
    assert_eq!((scan.power_up, scan.master_counts[0]), (last[2], 1234));
    assert_eq!(last[3], 1234);
    assert_eq!(daq.scans_missed(), 0);
    println!("MEASURED {} scans lost between two processes", scan.tick - last[0] - 1);
}

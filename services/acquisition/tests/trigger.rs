//! From the simulated card's trigger line to the volumes.
#![allow(clippy::unwrap_used)]

use acquisition::homing::Homing;
use acquisition::{Converter, Trigger};
use ipc_types::{LineEvent, ScannerPulse};
use rig::RigFile;
use runtime::daq::Daq;
use scanner::{Counts, Series, reconcile};
use simulator::LockStepDaq;

/// Ticks between two looks at the card.
const BATCH: u64 = 100;

/// The hydrostatic rig with lines in place of those given.
fn rig(changes: &[(&str, &str)]) -> RigFile {
    let shipped = rig::load_rig("hydrostatic".as_ref()).unwrap();
    let text = changes.iter().fold(shipped.text().to_owned(), |text, (from, to)| {
        assert!(text.contains(from), "{from}");
        text.replace(from, to)
    });
    RigFile::parse(&text, "test.toml").unwrap()
}

/// What a rig's trigger shows in so many ticks of its simulated card.
fn events(rig: &RigFile, ticks: u64) -> Vec<ScannerPulse> {
    let mut card = LockStepDaq::new(rig, &[], 5_000_000, false).unwrap();
    let (converter, homing) = (Converter::new(rig), Homing::absolute(rig));
    let mut trigger = Trigger::new(rig).unwrap();
    let mut events = Vec::new();
    for _ in 0..ticks / BATCH {
        card.advance(BATCH);
        let now_ns = card.now_ns();
        for scan in card.read_due(now_ns).unwrap() {
            events.extend(trigger.observe(&converter.convert(scan, homing.zeros())));
        }
    }
    events
}

fn pulses(events: &[ScannerPulse]) -> Vec<u64> {
    let pulse = |event: &&ScannerPulse| event.kind == LineEvent::Pulse.code();
    events.iter().filter(pulse).map(|event| event.at_ns).collect()
}

#[test]
fn a_thousand_noisy_volumes_with_five_missing_and_three_spurious_pulses() {
    let faults = "trigger_missing = [40, 41, 300, 777, 998]\ntrigger_spurious_s = [6.5, 20.1, \
                  40.1]\ntrigger_jitter_s = 0.001";
    let rig = rig(&[
        ("trigger_repetition_s = 0.0", "trigger_repetition_s = 0.1"),
        ("trigger_start_s = 0.0 ", "trigger_start_s = 0.05 "),
        ("trigger_volumes = 0 ", "trigger_volumes = 1000 "),
        ("trigger_jitter_s = 0.0", faults),
        ("trigger_pulse_s = 0.01 ", "trigger_pulse_s = 0.008 "),
        ("analog_noise_v = 0.001", "analog_noise_v = 0.02"),
    ]);
    let events = events(&rig, 202_000);
    assert_eq!(events.len(), 998, "no glitches");
    assert_eq!((events[997].pulses, events[997].glitches), (998, 0));
    let found = reconcile(pulses(&events), Series::new(0.1, Some(1000)));
    let expected = Counts { volumes: 995, missed: 5, spurious: 3, ..Counts::default() };
    assert_eq!(found.counts, expected);
    let interpolated: Vec<usize> =
        (0..found.volumes.len()).filter(|volume| found.volumes[*volume].interpolated).collect();
    assert_eq!((found.volumes.len(), interpolated), (1000, vec![40, 41, 300, 777, 998]));
}

#[test]
fn pulses_of_a_millisecond_on_a_digital_input_are_all_counted() {
    let rig = rig(&[
        ("trigger_repetition_s = 0.0", "trigger_repetition_s = 0.0503"),
        ("trigger_start_s = 0.0 ", "trigger_start_s = 0.02 "),
        ("trigger_pulse_s = 0.01 ", "trigger_pulse_s = 0.001 "),
        ("channel = \"scanner_trigger\"", "digital = 5"),
        ("threshold_v = 2.0\nhysteresis_v = 0.5 ", ""),
    ]);
    let events = events(&rig, 100_800);
    assert_eq!(pulses(&events).len(), 1002);
    assert_eq!(events.len(), 1002, "no glitches");
}

#[test]
fn a_pulse_shorter_than_the_least_width_is_told_as_a_glitch() {
    let rig = rig(&[
        ("trigger_repetition_s = 0.0", "trigger_repetition_s = 0.5"),
        ("trigger_start_s = 0.0 ", "trigger_start_s = 0.25 "),
        ("minimum_width_s = 0.0005", "minimum_width_s = 0.05"),
    ]);
    let events = events(&rig, 4_000);
    let kinds: Vec<u8> = events.iter().map(|event| event.kind).collect();
    assert_eq!(kinds, [LineEvent::Glitch.code(); 4]);
    assert_eq!((events[3].pulses, events[3].glitches), (0, 4));
}

#[test]
fn a_rig_without_a_trigger_has_none() {
    let shipped = rig(&[]);
    let (head, rest) = shipped.text().split_once("[scanner]").unwrap();
    let (_, tail) = rest.split_once("\n\n").unwrap();
    let text = format!("{head}{tail}").replace("kind = \"trigger\"", "kind = \"other\"");
    assert!(Trigger::new(&RigFile::parse(&text, "test.toml").unwrap()).is_none());
}

//! The scanner's trigger line in the rig file, and the scan in a protocol.
#![allow(clippy::unwrap_used)]

use rig::protocol::{Movement, Protocol};
use rig::{RigFile, ScannerInput};
use scanner::{Line, LineKind};

const RIG: &str = include_str!("../../rigs/hydrostatic.toml");
const SECTION: &str = "[scanner]\nchannel = \"scanner_trigger\"";

/// The shipped rig with another `[scanner]`.
fn with_line(section: &str) -> Result<RigFile, String> {
    let (head, rest) = RIG.split_once("[scanner]").unwrap();
    let (_, tail) = rest.split_once("# The declared model, and").unwrap();
    let text = format!("{head}{section}\n\n# The declared model, and{tail}");
    RigFile::parse(&text, "rig.toml").map_err(|error| error.to_string())
}

fn error(section: &str) -> String {
    with_line(section).unwrap_err()
}

#[test]
fn the_shipped_line_is_the_thesis_s_and_so_is_the_default() {
    assert!(RIG.contains(SECTION));
    let line = RigFile::parse(RIG, "rig.toml").unwrap().scanner.unwrap();
    assert_eq!((line.input, line.line), (ScannerInput::Analog(7), Line::default()));
    assert_eq!(with_line("").unwrap().scanner, Some(line));
    assert_eq!(line.volts(&[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 4.5], 0), Some(4.5));
    assert_eq!(line.volts(&[0.0], 0), None);
    let digital = with_line("[scanner]\ndigital = 3\nkind = \"gate\"\nactive = \"high\"").unwrap();
    let line = digital.scanner.unwrap();
    assert_eq!((line.input, line.line.kind), (ScannerInput::Digital(3), LineKind::Gate));
    assert_eq!((line.volts(&[], 0b1000), line.volts(&[], 0b0111)), (Some(1.0), Some(0.0)));
    // Threshold and band of a digital input lie between its two levels.
    let Line { threshold_v, hysteresis_v, .. } = line.line;
    assert!(threshold_v - hysteresis_v > 0.0 && threshold_v + hysteresis_v < 1.0);
}

#[test]
fn a_line_that_cannot_be_read_is_refused_with_its_key() {
    let text = error("[scanner]\nchannel = \"trigger\"");
    assert!(text.contains("scanner.channel: expected the name of a channel: \"scanner_trigger\""));
    let text = error("[scanner]\nchannel = \"emg_1\"");
    assert!(text.contains("scanner.channel: expected a channel of kind \"trigger\""), "{text}");
    let text = error("[scanner]\nthreshold_v = 9.9\nhysteresis_v = 0.4");
    assert!(text.contains("scanner.threshold_v: expected levels within the ±10 V"), "{text}");
    let text = error("[scanner]\ndigital = 1\nthreshold_v = 2.0");
    assert!(text.contains("scanner.threshold_v: expected nothing beside `digital`"), "{text}");
    let text = error("[scanner]\ndigital = 32");
    assert!(text.contains("scanner.digital: expected a whole number from 0 to 31"), "{text}");
    let text = error("[scanner]\nkind = \"puls\"");
    assert!(text.contains("did you mean \"pulse\"?"), "{text}");
}

#[test]
fn a_simulated_scanner_with_faults_is_checked() {
    let simulated = |lines: &str| {
        let text = RIG.replace("trigger_repetition_s = 0.0", "trigger_repetition_s = 2.0");
        let text = text.replace("trigger_jitter_s = 0.0", lines);
        RigFile::parse(&text, "rig.toml").map_err(|error| error.to_string())
    };
    let rig = simulated("trigger_jitter_s = 0.01\ntrigger_missing = [3, 5]").unwrap();
    let scanner = rig.simulation.scanner.unwrap();
    assert_eq!((scanner.faults.jitter_s, scanner.faults.missing), (0.01, vec![3, 5]));
    let text = simulated("trigger_jitter_s = 0.5").unwrap_err();
    assert!(text.contains("simulation.trigger_jitter_s: expected at most 0.2843 s"), "{text}");
    let level = |from: &str, to: &str, line: (&str, &str)| {
        let text = RIG.replace("trigger_repetition_s = 0.0", "trigger_repetition_s = 2.0");
        let text = text.replace(from, to).replace(line.0, line.1);
        RigFile::parse(&text, "rig.toml").map_err(|error| error.to_string())
    };
    let none = ("[scanner]", "[scanner]");
    let text = level("trigger_pulse_v = 0.0", "trigger_pulse_v = 3.0", none).unwrap_err();
    assert!(
        text.contains("trigger_pulse_v: expected a level that [scanner] reads as active: well")
    );
    let high = ("active = \"low\"", "active = \"high\"");
    let text = level("trigger_pulse_v = 0.0", "trigger_pulse_v = 0.1", high).unwrap_err();
    assert!(text.contains("trigger_idle_v: expected a level that [scanner] reads as idle: well"));
    let toggle = ("kind = \"pulse\"", "kind = \"toggle\"");
    let text = level("trigger_pulse_v = 0.0", "trigger_pulse_v = 0.1", toggle).unwrap_err();
    assert!(text.contains("trigger_repetition_s: expected kind \"pulse\" in [scanner]"), "{text}");
    let text = simulated("trigger_missing = [1.5]").unwrap_err();
    assert!(text.contains("simulation.trigger_missing: expected whole numbers"), "{text}");
}

fn protocol(scan: &str, wait: &str) -> Result<Protocol, String> {
    let text = format!(
        "[protocol]\nname = \"scan\"\n{scan}\n[[segments]]\nkind = \"wait_for_scanner\"\n{wait}\n"
    );
    Protocol::parse(&text, "scan.toml").map_err(|error| error.to_string())
}

#[test]
fn a_protocol_says_what_it_expects_of_the_scan() {
    let read = protocol("[scanner]\nrepetition_s = 2.0\nvolumes = 300", "timeout_s = 60").unwrap();
    let scan = read.scan.unwrap();
    assert_eq!((scan.series.repetition_s, scan.series.volumes), (2.0, Some(300)));
    assert_eq!((scan.series.tolerance_s, scan.in_step), (0.1, true));
    let Movement::WaitForScanner(wait) = &read.segments[0].movement else { unreachable!() };
    assert_eq!((wait.timeout_s, wait.pulse, wait.start_up_s), (60.0, 1, 0.0));
    assert!(protocol("", "timeout_s = 60").unwrap().scan.is_none());
    for (scan, wait, expected) in [
        ("[scanner]\nvolumes = 3", "timeout_s = 60", "scanner.repetition_s: expected a number"),
        ("[scanner]\nrepetition_s = 0", "timeout_s = 60", "a number from 0.02 to 60"),
        (
            "[scanner]\nrepetition_s = 2\ntolerance_s = 0.6",
            "timeout_s = 60",
            "scanner.tolerance_s: expected at most a quarter of repetition_s (0.5 s)",
        ),
        ("", "", "segments.0.timeout_s: expected a number"),
        ("", "timeout_s = 60\npulse = 0", "segments.0.pulse: expected a whole number from 1"),
        ("", "timeout_s = 60\nstart_up_s = 1000", "segments.0.start_up_s: expected a number from"),
    ] {
        let text = protocol(scan, wait).unwrap_err();
        assert!(text.contains(expected), "{text}");
    }
}

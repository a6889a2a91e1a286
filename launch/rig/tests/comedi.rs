//! The wiring of a comedi card: what is read, and messages for mistakes.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use comedi::{CounterMode, Edges};
use ipc_types::CardKind;
use rig::RigFile;

const RIG: &str = include_str!("comedi.toml");

fn edited(from: &str, to: &str) -> String {
    assert_eq!(RIG.matches(from).count(), 1, "the edit must hit one place: {from}");
    RIG.replace(from, to)
}

/// The message after one edit.
fn error(from: &str, to: &str) -> String {
    RigFile::parse(&edited(from, to), "rig.toml").unwrap_err().to_string()
}

#[test]
fn the_wiring_is_read_with_its_defaults() {
    let rig = RigFile::parse(RIG, "rig.toml").unwrap();
    assert_eq!(rig.card, Some(CardKind::Comedi));
    let card = rig.comedi.unwrap();
    assert_eq!((card.device.as_str(), card.reference, card.convert_ns), ("/dev/comedi2", 0, 0));
    assert!(card.has_outputs());
    let axis = &card.axes[0];
    assert_eq!(axis.output.unwrap().range_v, 10.0);
    assert_eq!(card.node(&axis.master.device), "/dev/comedi1");
    assert_eq!(axis.master.mode, CounterMode::Counting);
    assert!(card.motor_power.unwrap().active_low);
    assert_eq!(card.digital_outputs.unwrap().mask(), 0xff);
}

#[test]
fn counters_and_corrections_of_a_real_card() {
    let text = edited(
        "mode = \"none\" }\nslave",
        "mode = \"quadrature-x4\", a = 8, b = 10 }\nreadback = 7\noutput_gain = 1.001\nslave",
    );
    let text = format!("{text}\n[[comedi.calibration]]\nindex = 7\ngain = 2.4\noffset_v = 0.01\n");
    let card = RigFile::parse(&text, "rig.toml").unwrap().comedi.unwrap();
    let axis = &card.axes[0];
    assert_eq!(axis.master.mode, CounterMode::Quadrature(Edges::Four));
    assert_eq!((axis.master.inputs, axis.readback), (Some([8, 10]), Some(7)));
    let line = card.calibration[0].line;
    assert!((line.terminal_v(10.0) - 24.01).abs() < 1e-12);
    assert!((line.converter_v(24.01) - 10.0).abs() < 1e-12);
}

/// A real card is armed in the realtime profile only, whose timeouts are short.
#[test]
fn rates_that_the_realtime_profile_cannot_arm_are_refused() {
    let slow = edited("control_hz = 500", "control_hz = 125");
    assert_eq!(
        RigFile::parse(&slow, "rig.toml").unwrap_err().to_string(),
        "rig.toml:9: rates.control_hz: expected commands at the gate of at most 4.88 ms (timeouts \
         of the profile realtime), found 7.88 ms at 125 Hz; raise the rate, or move phases_us: a \
         real card is armed in the profile realtime only"
    );
    // A rig whose motors the card does not drive is never armed.
    let text = slow.replace("output_channel = 0\n", "");
    let problems = RigFile::parse(&text, "rig.toml").err().map(|error| error.to_string());
    assert!(!problems.unwrap_or_default().contains("rates."));
}

#[test]
fn a_rig_that_is_only_measured_needs_no_lines() {
    let text = edited("output_channel = 0\n", "");
    let text = text.replace("[comedi.enable_line]", "[comedi.digital.unused]");
    let without = |name: &str, text: &str| {
        let begin = text.find(name).unwrap();
        let end = begin + text[begin + 1..].find("\n[").unwrap() + 2;
        format!("{}{}", &text[..begin], &text[end..])
    };
    let text = without("[comedi.digital.unused]", &text);
    let text = without("[comedi.motor_power]", &text);
    let card = RigFile::parse(&text, "rig.toml").unwrap().comedi.unwrap();
    assert!(!card.has_outputs() && card.enable_line.is_none());
}

#[test]
fn mistakes_are_told_with_key_expected_and_found() {
    for (from, to, expected) in [
        ("[comedi.enable_line]", "[comedi.enabel_line]", "did you mean `enable_line`?"),
        (
            "subdevice = 2\nchannel = 0\n\n[comedi.motor_power]\ndevice = \"/dev/comedi0\"\n\
             subdevice = 1\nchannel = 4",
            "subdevice = 2\nchannel = 0\n\n[comedi.motor_power]\ndevice = \"/dev/comedi0\"\n\
             subdevice = 2\nchannel = 0",
            "comedi.motor_power: expected lines that comedi.enable_line does not use",
        ),
        (
            "channel = 1, mode = \"none\"",
            "channel = 0, mode = \"none\"",
            "comedi.axes.0.slave: expected a counter of its own",
        ),
        (
            "[axes.slave]\ncounts_per_metre = 2.0e7\n",
            "",
            "comedi.axes.0.slave: expected nothing: the axis has no [axes.slave]",
        ),
        (
            "output_channel = 0",
            "output_channel = 0\noutput_range_v = 5.0",
            "output_range_v: expected at least axes.0.limits.volts_max (10 V), found 5",
        ),
        (
            "output_channel = 0",
            "output_channel = 0\nreadback = 9",
            "comedi.axes.0.readback: expected the index of one of [[channels]], found 9",
        ),
        (
            "driver = \"comedi_test\"",
            "convert_us = 100.0",
            "comedi.convert_us: expected a scan within 500 µs, the period of acquisition, found \
             800 µs for 8 channels",
        ),
        (
            "channel = 0, mode = \"none\"",
            "channel = 0, mode = \"quadrature\"",
            "comedi.axes.0.master.mode: expected one of \"none\", \"quadrature-x1\"",
        ),
        (
            "channel = 0, mode = \"none\"",
            "channel = 0, mode = \"none\", a = 3",
            "comedi.axes.0.master.b: expected both terminals, or none, found one; add the other",
        ),
        ("card = \"comedi\"", "card = \"comedy\"", "did you mean \"comedi\"?"),
        ("first = 0\ncount = 8", "first = 30\ncount = 8", "expected lines 0 to 31, found line 37"),
        ("output_channel = 0\n", "", "comedi.enable_line: expected nothing: no axis has an output"),
    ] {
        let message = error(from, to);
        assert!(message.contains(expected), "{to}:\n{message}");
    }
}

#[test]
fn a_motor_needs_its_line_and_the_sight_of_its_power() {
    let start = RIG.find("[comedi.enable_line]").unwrap();
    let end = RIG.find("[comedi.digital.inputs]").unwrap();
    let text = format!("{}{}", &RIG[..start], &RIG[end..]);
    let message = RigFile::parse(&text, "rig.toml").unwrap_err().to_string();
    for key in
        ["comedi.enable_line: expected the motor's", "comedi.motor_power: expected the input"]
    {
        assert!(message.contains(key), "{message}");
    }
    let start = RIG.find("[comedi]").unwrap();
    let end = RIG.find("[model]").unwrap();
    let text = format!("{}{}", &RIG[..start], &RIG[end..]);
    let message = RigFile::parse(&text, "rig.toml").unwrap_err().to_string();
    assert!(message.contains("card: expected a section [comedi]"), "{message}");
}

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

const SLAVE: &str =
    "slave = { device = \"/dev/comedi1\", subdevice = 1, channel = 1, mode = \"none\" }\n";

/// The rig with more keys for its axis of the card.
fn with_keys(keys: &str) -> String {
    edited(SLAVE, &format!("{SLAVE}{keys}\n"))
}

/// The rig with a force cell at its third input.
fn with_force_cell(text: &str) -> String {
    let cell =
        "[axes.torque]\nchannel = 2\nvolts_per_n = 0.1\n\n[axes.limits]\nforce_max_n = 50.0\n";
    let text = text.replace("[axes.limits]\n", cell);
    text.replace("name = \"flat_2\"\nkind = \"other\"", "name = \"flat_2\"\nkind = \"torque\"")
}

#[test]
fn a_sensor_s_fault_line_is_read_with_its_level() {
    let text = with_force_cell(&with_keys(
        "master_fault = { subdevice = 2, channel = 3 }\n\
         slave_fault = { device = \"/dev/comedi3\", subdevice = 2, channel = 3 }\n\
         torque_fault = { subdevice = 2, channel = 4, active = \"low\" }",
    ));
    let card = RigFile::parse(&text, "rig.toml").unwrap().comedi.unwrap();
    let keys: Vec<String> = card.signals().into_iter().map(|(key, _)| key).collect();
    assert_eq!(
        keys,
        [
            "comedi.motor_power",
            "comedi.axes.0.master_fault",
            "comedi.axes.0.slave_fault",
            "comedi.axes.0.torque_fault"
        ]
    );
    let [(_, master), (_, slave), (_, torque)] = card.axes[0].fault_lines();
    let (master, slave, torque) = (master.unwrap(), slave.unwrap(), torque.unwrap());
    assert_eq!(
        (card.node(&master.line.device), card.node(&slave.line.device)),
        ("/dev/comedi2", "/dev/comedi3")
    );
    assert_eq!((torque.line.subdevice, torque.line.mask()), (2, 1 << 4));
    for (line, high, low) in [(master, true, false), (slave, true, false), (torque, false, true)] {
        assert_eq!((line.is_active(true), line.is_active(false)), (high, low));
    }
    // A rig without them has none.
    let card = RigFile::parse(RIG, "rig.toml").unwrap().comedi.unwrap();
    assert!(card.axes[0].fault_lines().iter().all(|(_, line)| line.is_none()));
}

#[test]
fn a_fault_line_has_one_purpose_and_a_sensor() {
    let at = |subdevice: u32, channel: u32| {
        format!("{{ device = \"/dev/comedi0\", subdevice = {subdevice}, channel = {channel} }}")
    };
    let master = |line: String| with_keys(&format!("master_fault = {line}"));
    let two = format!("master_fault = {}\nslave_fault = {}", at(1, 5), at(1, 5));
    let cases = [
        (
            master(at(2, 0)),
            "comedi.axes.0.master_fault: expected lines that comedi.enable_line does not use, \
             found subdevice 2, line 0; each line has one purpose",
        ),
        (
            master(at(1, 4)),
            "comedi.axes.0.master_fault: expected lines that comedi.motor_power does not use",
        ),
        (
            master(at(1, 3)),
            "comedi.digital.inputs: expected lines that comedi.axes.0.master_fault does not use, \
             found subdevice 1, line 3",
        ),
        (
            master(at(0, 7)),
            "comedi.digital.outputs: expected lines that comedi.axes.0.master_fault does not use, \
             found subdevice 0, line 7",
        ),
        (
            with_keys(&two),
            "comedi.axes.0.slave_fault: expected lines that comedi.axes.0.master_fault does not",
        ),
        (
            with_keys(&format!("torque_fault = {}", at(1, 5))),
            "comedi.axes.0.torque_fault: expected nothing: the axis has no [axes.torque], found a \
             line; add the section, or take the line out",
        ),
        (
            with_keys(&format!("slave_fault = {}", at(1, 5)))
                .replace("[axes.slave]\ncounts_per_metre = 2.0e7\n", ""),
            "comedi.axes.0.slave_fault: expected nothing: the axis has no [axes.slave]",
        ),
        (
            with_keys("master_fault = { subdevice = 1, channel = 0, active = \"hi\" }"),
            "comedi.axes.0.master_fault.active: expected one of \"high\", \"low\"",
        ),
        (
            with_keys("master_fault = { subdevice = 1 }"),
            "comedi.axes.0.master_fault.channel: expected",
        ),
    ];
    for (text, expected) in cases {
        let message = RigFile::parse(&text, "rig.toml").unwrap_err().to_string();
        assert!(message.contains(expected), "{expected}:\n{message}");
    }
    // A line of that number elsewhere is another one.
    let text = master("{ device = \"/dev/comedi2\", subdevice = 1, channel = 4 }".to_owned());
    RigFile::parse(&text, "rig.toml").unwrap();
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

//! Checks of `[comedi]` against the rest of the rig file.

use crate::channel::Channel;
use crate::checked_toml::Source;
use crate::comedi_card::{ComediCard, DigitalLines, EncoderCounter};
use crate::rig_file::RigFile;

/// Checks the wiring of the card.
pub(crate) fn check(rig: &RigFile, card: &ComediCard, source: &Source<'_>) {
    if rig.channels.is_empty() {
        let advice = "add the [[channels]] that the card measures: their scans are the samples";
        source.problem("comedi", "at least one analog input", "none", advice);
    }
    let scan_ns = u64::from(card.convert_ns) * rig.channels.len() as u64;
    let period_ns = rig.rates.acquisition_period_ns();
    if scan_ns > period_ns {
        let expected = format!("a scan within {} µs, the period of acquisition", period_ns / 1000);
        let found = format!("{} µs for {} channels", scan_ns / 1000, rig.channels.len());
        source.problem("comedi.convert_us", expected, found, "shorten it");
    }
    for (at, calibration) in card.calibration.iter().enumerate() {
        let key = format!("comedi.calibration.{at}.index");
        is_channel(&rig.channels, calibration.index, &key, source);
        if card.calibration[..at].iter().any(|other| other.index == calibration.index) {
            let expected = "an input that was not corrected before";
            source.problem(&key, expected, calibration.index, "take one of the two out");
        }
    }
    axes(rig, card, source);
    faults(rig, card, source);
    lines(card, source);
}

fn is_channel(channels: &[Channel], index: usize, key: &str, source: &Source<'_>) {
    if !channels.iter().any(|channel| channel.index == index) {
        source.problem(key, "the index of one of [[channels]]", index, "add the channel");
    }
}

fn axes(rig: &RigFile, card: &ComediCard, source: &Source<'_>) {
    if card.axes.len() != rig.axes.len() {
        let expected = format!("{}, as many as [[axes]]", rig.axes.len());
        let advice = "write each as [[comedi.axes]], in the order of [[axes]]";
        source.problem("comedi.axes", expected, card.axes.len(), advice);
        return;
    }
    let mut counters: Vec<(&str, &EncoderCounter)> = Vec::new();
    for (at, (axis, wiring)) in rig.axes.iter().zip(&card.axes).enumerate() {
        let key = |name: &str| format!("comedi.axes.{at}.{name}");
        if axis.slave.is_some() != wiring.slave.is_some() {
            let (expected, found) = match axis.slave {
                Some(_) => ("the counter of the slave's encoder", "nothing"),
                None => ("nothing: the axis has no [axes.slave]", "a counter"),
            };
            source.problem(&key("slave"), expected, found, "let both sections say the same");
        }
        if let Some(index) = wiring.readback {
            is_channel(&rig.channels, index, &key("readback"), source);
        }
        match &wiring.output {
            Some(output) => {
                let volts = axis.limits.volts_max;
                if output.range_v < volts {
                    let expected = format!("at least axes.{at}.limits.volts_max ({volts} V)");
                    let advice = "widen the range, or lower the limit";
                    source.problem(&key("output_range_v"), expected, output.range_v, advice);
                }
                let same = |other: &crate::comedi_card::ComediAxis| {
                    other.output.is_some_and(|other| other.channel == output.channel)
                };
                if card.axes[..at].iter().any(same) {
                    let expected = "an output of its own";
                    let advice = "each output drives one motor";
                    source.problem(&key("output_channel"), expected, output.channel, advice);
                }
            }
            None if card.has_outputs() => {
                let expected = "the output of its motor, as the other axes have";
                source.problem(&key("output_channel"), expected, "nothing", "add the key");
            }
            None => {}
        }
        let own = [("master", Some(&wiring.master)), ("slave", wiring.slave.as_ref())];
        for (name, counter) in own {
            let Some(counter) = counter else { continue };
            let node = card.node(&counter.device);
            let place = |other: &EncoderCounter| (other.subdevice, other.channel);
            if counters.iter().any(|(at, other)| *at == node && place(other) == place(counter)) {
                let expected = "a counter of its own";
                let found = format!("subdevice {} again", counter.subdevice);
                source.problem(&key(name), expected, found, "each encoder needs a counter");
            }
            counters.push((node, counter));
        }
    }
}

/// A line reports a fault of a sensor that there is.
fn faults(rig: &RigFile, card: &ComediCard, source: &Source<'_>) {
    for (at, (axis, wiring)) in rig.axes.iter().zip(&card.axes).enumerate() {
        for (name, line, is_there, section) in [
            ("slave_fault", &wiring.slave_fault, axis.slave.is_some(), "[axes.slave]"),
            ("torque_fault", &wiring.torque_fault, axis.torque.is_some(), "[axes.torque]"),
        ] {
            if line.is_some() && !is_there {
                let key = format!("comedi.axes.{at}.{name}");
                let expected = format!("nothing: the axis has no {section}");
                source.problem(&key, expected, "a line", "add the section, or take the line out");
            }
        }
    }
}

/// The lines that a motor needs, and that none of them is used twice.
fn lines(card: &ComediCard, source: &Source<'_>) {
    let required = [
        ("comedi.enable_line", card.enable_line.is_some(), "the motor's enable line"),
        ("comedi.motor_power", card.motor_power.is_some(), "the input that sees the motor's power"),
    ];
    for (key, is_there, expected) in required {
        if card.has_outputs() && !is_there {
            let advice = "no motor runs without it: see docs/comedi.md";
            source.problem(key, expected, "nothing", advice);
        }
    }
    if !card.has_outputs() && card.enable_line.is_some() {
        let advice = "add output_channel to [[comedi.axes]], or take the line out";
        source.problem("comedi.enable_line", "nothing: no axis has an output", "a line", advice);
    }
    let mut all: Vec<(String, &DigitalLines)> = Vec::new();
    all.extend(card.enable_line.iter().map(|line| ("comedi.enable_line".to_owned(), line)));
    all.extend(card.signals().into_iter().map(|(key, signal)| (key, &signal.line)));
    for (key, lines) in [
        ("comedi.digital.inputs", card.digital_inputs.as_ref()),
        ("comedi.digital.outputs", card.digital_outputs.as_ref()),
    ] {
        all.extend(lines.map(|lines| (key.to_owned(), lines)));
    }
    for (at, (key, lines)) in all.iter().enumerate() {
        if lines.first + lines.count > 32 {
            let last = lines.first + lines.count - 1;
            source.problem(key, "lines 0 to 31", format!("line {last}"), "take fewer");
        }
        for (other, before) in &all[..at] {
            let same = before.subdevice == lines.subdevice
                && card.node(&before.device) == card.node(&lines.device);
            let shared = if same { before.mask() & lines.mask() } else { 0 };
            // What sees the power may be among the inputs of the samples, too.
            if shared != 0 && !(other == "comedi.motor_power" && key == "comedi.digital.inputs") {
                let expected = format!("lines that {other} does not use");
                let line = shared.trailing_zeros();
                let found = format!("subdevice {}, line {line}", lines.subdevice);
                source.problem(key, expected, found, "each line has one purpose");
            }
        }
    }
}

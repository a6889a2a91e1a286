//! The scanner of the simulated card.

use plant::sensors::{ScannerEmulator, ScannerTrigger, TriggerFaults};
use scanner::LineKind;

use crate::channel::{Channel, ChannelKind};
use crate::checked_toml::{Section, Source, bounds};
use crate::rates::Rates;
use crate::scanner_line::{ScannerInput, ScannerLine};

/// A digital input reads a level above this as high (V).
pub const DIGITAL_HIGH_V: f64 = 1.5;
/// Shortest repetition time of the trigger's model (s).
const SHORTEST_REPETITION_S: f64 = 1e-3;
/// Most volumes, and longest time, of a simulated scan.
const MOST: f64 = 1e9;

/// Reads the scanner's keys; `None` where no scanner runs.
pub(crate) fn read_scanner(section: &Section<'_>, seed: u64) -> Option<ScannerEmulator> {
    let number = |key, default, least, most, advice| {
        section.number_or(key, default, bounds(least, most, advice))
    };
    let usual = ScannerTrigger::default();
    let repetition_s =
        number("trigger_repetition_s", 0.0, 0.0, 60.0, "TR in s; 0 where no scanner runs");
    let trigger = ScannerTrigger {
        repetition_s,
        pulse_s: number("trigger_pulse_s", usual.pulse_s, 1e-6, 60.0, "length of a pulse, in s"),
        idle_v: number("trigger_idle_v", usual.idle_v, -10.0, 10.0, "level between pulses, in V"),
        pulse_v: number("trigger_pulse_v", usual.pulse_v, -10.0, 10.0, "level of a pulse, in V"),
        start_s: number("trigger_start_s", usual.start_s, 0.0, MOST, "in s"),
        volumes: number("trigger_volumes", usual.volumes, 0.0, MOST, "0: without end"),
    };
    if repetition_s > 0.0 && repetition_s < SHORTEST_REPETITION_S {
        let expected = format!("0 or at least {SHORTEST_REPETITION_S} s");
        let advice = "TR in s; 0 where no scanner runs";
        section.problem("trigger_repetition_s", expected, repetition_s, advice);
    }
    let missing = section
        .numbers_or_none("trigger_missing", bounds(0.0, MOST, "numbers of volumes, from 0"))
        .unwrap_or_default();
    let whole = |key, number: f64| {
        if number.fract() != 0.0 {
            section.problem(key, "whole numbers", number, "volumes are counted from 0");
        }
    };
    whole("trigger_volumes", trigger.volumes);
    missing.iter().for_each(|volume| whole("trigger_missing", *volume));
    let spurious = bounds(0.0, MOST, "in s, from the card's first scan");
    let faults = TriggerFaults {
        jitter_s: number("trigger_jitter_s", 0.0, 0.0, 1.0, "in s, standard deviation"),
        missing: missing.into_iter().map(|volume| volume as u64).collect(),
        spurious_s: section.numbers_or_none("trigger_spurious_s", spurious).unwrap_or_default(),
        seed,
    };
    (repetition_s > 0.0).then_some(ScannerEmulator { trigger, faults })
}

/// Checks the scanner against channels and rates.
pub(crate) fn check(
    scanner: &ScannerEmulator,
    line: Option<&ScannerLine>,
    channels: &[Channel],
    rates: &Rates,
    source: &Source<'_>,
) {
    let ScannerEmulator { trigger, faults } = scanner;
    let key = |name: &str| format!("simulation.{name}");
    let scan_s = rates.acquisition_period_ns() as f64 * 1e-9;
    let jitter_limit_s = ScannerEmulator::jitter_limit_s(trigger);
    if trigger.pulse_s >= trigger.repetition_s {
        let expected = format!("less than trigger_repetition_s ({} s)", trigger.repetition_s);
        let advice = "a pulse ends before the next begins";
        source.problem(&key("trigger_pulse_s"), expected, trigger.pulse_s, advice);
    } else if trigger.pulse_s < scan_s || trigger.repetition_s - trigger.pulse_s < scan_s {
        let expected = format!("at least one scan ({scan_s} s), and as much between two pulses");
        let advice = "what is shorter falls between two scans and is missed";
        source.problem(&key("trigger_pulse_s"), expected, trigger.pulse_s, advice);
    } else if faults.jitter_s > jitter_limit_s {
        let expected = format!("at most {jitter_limit_s:.4} s");
        let advice = "two pulses must not meet: jitter less, or lower trigger_pulse_s";
        source.problem(&key("trigger_jitter_s"), expected, faults.jitter_s, advice);
    }
    let inputs: Vec<_> =
        channels.iter().filter(|channel| channel.kind == ChannelKind::Trigger).collect();
    let digital = line.is_some_and(|line| matches!(line.input, ScannerInput::Digital(_)));
    if inputs.is_empty() && !digital {
        let (expected, found) = ("0, as no channel is of kind \"trigger\"", trigger.repetition_s);
        let advice = "add [[channels]] with kind = \"trigger\", or switch the scanner off";
        source.problem(&key("trigger_repetition_s"), expected, found, advice);
    }
    for channel in inputs {
        for (name, volts) in
            [("trigger_idle_v", trigger.idle_v), ("trigger_pulse_v", trigger.pulse_v)]
        {
            if volts.abs() > channel.range_v {
                let (range, name_of) = (channel.range_v, &channel.name);
                let expected = format!("within the ±{range} V of the channel \"{name_of}\"");
                let advice = "widen the channel's range_v, or lower the level";
                source.problem(&key(name), expected, volts, advice);
            }
        }
    }
    if let Some(line) = line {
        check_levels(trigger, line, source);
    }
    if trigger.idle_v == trigger.pulse_v {
        let expected = format!("another level than trigger_idle_v ({} V)", trigger.idle_v);
        let advice = "a pulse must change the level";
        source.problem(&key("trigger_pulse_v"), expected, trigger.pulse_v, advice);
    }
}

/// Checks that the line reads the scanner's levels as idle and active.
fn check_levels(trigger: &ScannerTrigger, line: &ScannerLine, source: &Source<'_>) {
    if line.line.kind != LineKind::Pulse {
        let expected = "kind \"pulse\" in [scanner], as the simulated scanner sends pulses";
        let advice = "change the kind, or switch the simulated scanner off";
        let key = "simulation.trigger_repetition_s";
        source.problem(key, expected, trigger.repetition_s, advice);
        return;
    }
    for (key, volts, active) in [
        ("simulation.trigger_idle_v", trigger.idle_v, false),
        ("simulation.trigger_pulse_v", trigger.pulse_v, true),
    ] {
        let (read_v, side) = match line.input {
            ScannerInput::Analog(_) => (volts, line.line.threshold_v),
            ScannerInput::Digital(_) => (f64::from(volts > DIGITAL_HIGH_V), DIGITAL_HIGH_V),
        };
        if line.line.state_of(read_v) != Some(active) {
            let below = active == line.line.active_low;
            let expected = format!(
                "a level that [scanner] reads as {}: {} {side} V",
                if active { "active" } else { "idle" },
                if below { "well below" } else { "well above" },
            );
            source.problem(key, expected, volts, "change the level, or [scanner]");
        }
    }
}

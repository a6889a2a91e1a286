//! `report.html`: the results of a run on one page.

use ipc_types::{Process, Sample, TripCause};
use report::Colour::{Blue, Green, Grey, Orange, Purple, Sky, Vermillion};
use report::{Figure, Page, Table, Tone};
use rig::RigFile;

use crate::analysis::{Analysis, Model, Outage, Trace, master, slave, unpowered_spans};
use crate::demonstrated::Run;
use crate::display_unit::DisplayUnit;
use crate::tables::{events, tables};
use crate::{Outcome, Summary};

/// Wide figures, CSS pixels.
const WIDTH: u32 = 860;

/// The page of one run.
///
/// # Errors
/// Where a figure cannot be drawn.
pub fn page(
    analysis: &Analysis,
    summary: &Summary,
    outcome: &Outcome,
    run: &Run,
    rig: &RigFile,
) -> anyhow::Result<String> {
    let shown = DisplayUnit::of(rig);
    let json = serde_json::to_string_pretty(summary).unwrap_or_default();
    let mut page = Page::new(format!("farreach demo: {}", rig.name))
        .subtitle(&subtitle(analysis, summary, rig));
    let kills = (tone(analysis, outcome), sentence(analysis, outcome), detail(analysis, outcome));
    if let Some((tone, sentence, detail)) = run.closed_loop.verdict(run.hidden.as_deref()) {
        page = page.verdict(tone, &sentence, &detail);
    }
    page = page.verdict(kills.0, &kills.1, &kills.2);
    page = run.closed_loop.section(run.identified.section(page));
    page = page.heading("Killed in mid-movement").figure(&overview(analysis, &shown), OVERVIEW);
    for (index, outage) in analysis.outages.iter().enumerate() {
        page = self::outage(page, analysis, outage, index, &shown);
    }
    if let Some(model) = &analysis.model {
        page = self::model(page, model, summary, &shown);
    }
    tables(page, analysis, summary)
        .details("Events, in order", &events(&analysis.trace))
        .details("summary.json", &json)
        .footer(&format!(
            "farreach demo {}, revision {}",
            env!("CARGO_PKG_VERSION"),
            summary.revision
        ))
        .render()
}

fn subtitle(analysis: &Analysis, summary: &Summary, rig: &RigFile) -> String {
    let seconds = analysis
        .trace
        .samples
        .last()
        .map_or(0.0, |sample| analysis.trace.seconds(sample.scan_time_ns));
    format!(
        "Simulated rig \"{}\", {} timing, {seconds:.1} s at {} Hz, {}. {}.",
        rig.name,
        summary.profile,
        rig.rates.acquisition_hz,
        match &summary.injected {
            Some(effect) => format!("with the effect {effect} in the plant and not in the model"),
            None => "with no effect beyond the declared model".to_owned(),
        },
        rig.description,
    )
}

fn tone(analysis: &Analysis, outcome: &Outcome) -> Tone {
    match outcome {
        Outcome::Kept if analysis.unprovoked.is_empty() => Tone::Good,
        Outcome::Kept => Tone::Warning,
        Outcome::DataLost(_) => Tone::Warning,
        Outcome::Broken(_) => Tone::Bad,
    }
}

fn sentence(analysis: &Analysis, outcome: &Outcome) -> String {
    match outcome {
        Outcome::Kept => {
            let worst =
                analysis.outages.iter().filter_map(|outage| outage.trip_ms).fold(0.0, f64::max);
            let victims: Vec<&str> =
                analysis.outages.iter().map(|outage| outage.kill.process.text()).collect();
            format!(
                "Killed during movement: {}. The motor was at 0 V within {worst:.1} ms, and no \
                    sample was lost.",
                victims.join(", then ")
            )
        }
        Outcome::DataLost(_) => "The motor was safe, but the recording is incomplete.".to_owned(),
        Outcome::Broken(_) => "A requirement was not met.".to_owned(),
    }
}

fn detail(analysis: &Analysis, outcome: &Outcome) -> String {
    match outcome {
        Outcome::Kept => {
            let back =
                analysis.outages.iter().filter_map(|outage| outage.restart_ms).fold(0.0, f64::max);
            let tripped = match analysis.unprovoked.len() {
                0 => String::new(),
                count => format!(
                    " The watchdog also tripped {count} times without a kill, usually because a \
                        loop missed its deadline: the host is too busy or does not grant real-time \
                        scheduling (see Timing). This is safe, but interrupts the movement."
                ),
            };
            format!(
                "The launcher restarted each killed process within {back:.0} ms. All {} samples \
                    clocked by the card are on disk, with consecutive ticks. All numbers on this \
                    page are computed from the recording.{tripped}",
                analysis.losses.samples
            )
        }
        _ => format!("{}.", outcome.reasons().join("; ")),
    }
}

const OVERVIEW: &str = "Reference of the guided movement, master (motor) and slave (handle). At \
    each vertical line a process was killed with SIGKILL. The motor then has no power (shaded) \
    until the operator resets, arms and enables the rig; the restarted protocol begins at the \
    measured position.";

fn overview(analysis: &Analysis, shown: &DisplayUnit) -> Figure {
    let trace = &analysis.trace;
    let (time, reference) = reference(trace, shown, f64::NEG_INFINITY, f64::INFINITY);
    let sample_time: Vec<f64> =
        trace.samples.iter().map(|sample| trace.seconds(sample.scan_time_ns)).collect();
    let mut figure =
        Figure::new("Movement", "time / s", format!("position / {}", shown.unit)).size(WIDTH, 320);
    let extent = trace
        .samples
        .iter()
        .map(|sample| master(sample).abs().max(slave(sample).abs()) * shown.factor);
    let extent = extent.filter(|value| value.is_finite()).fold(1.0, f64::max) * 1.1;
    for (index, (from, until)) in unpowered_spans(&trace.tokens).into_iter().enumerate() {
        let name = if index == 0 { "no power" } else { "" };
        let span = [trace.seconds(from), trace.seconds(until)];
        figure = figure.band(Orange, name, &span, &[-extent; 2], &[extent; 2]);
    }
    figure = figure
        .y_range(-extent, extent)
        .dashed(Grey, "reference", &time, &reference)
        .line(Blue, "master", &sample_time, &shown.scale(trace.samples.iter().map(master)))
        .line(Vermillion, "slave", &sample_time, &shown.scale(trace.samples.iter().map(slave)));
    for outage in &analysis.outages {
        figure = figure.vertical(
            Grey,
            format!("{} killed", outage.kill.process),
            trace.seconds(outage.kill.at_ns),
        );
    }
    figure
}

/// Reference position between two instants (s); a hole where there was no control.
fn reference(trace: &Trace, shown: &DisplayUnit, from: f64, until: f64) -> (Vec<f64>, Vec<f64>) {
    let (mut time, mut values) = (Vec::new(), Vec::new());
    let mut before = None;
    for command in &trace.commands {
        let at = trace.seconds(command.time_ns);
        if at < from || at > until {
            continue;
        }
        if before.is_some_and(|before| before != command.incarnation) {
            time.push(at);
            values.push(f64::NAN);
        }
        before = Some(command.incarnation);
        time.push(at);
        values.push(command.reference_position[0] * shown.factor);
    }
    (time, values)
}

/// Step lines: a value holds until the next.
fn stairs(points: impl Iterator<Item = (f64, f64)>) -> (Vec<f64>, Vec<f64>) {
    let (mut x, mut y): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
    for (at, value) in points {
        if let Some(&last) = y.last()
            && last != value
        {
            x.push(at);
            y.push(last);
        }
        x.push(at);
        y.push(value);
    }
    (x, y)
}

/// What is shown of one kill.
struct KillView<'a> {
    trace: &'a Trace,
    outage: &'a Outage,
    /// Which kill, for titles.
    name: String,
    /// Range of the figures round the kill (ms since the kill).
    range_ms: (f64, f64),
}

fn outage(
    page: Page,
    analysis: &Analysis,
    outage: &Outage,
    index: usize,
    shown: &DisplayUnit,
) -> Page {
    let process = outage.kill.process;
    let trace = &analysis.trace;
    let kill_s = trace.seconds(outage.kill.at_ns);
    let name = format!("Kill {}: {process}", index + 1);
    let page = page.heading(&format!("{name} at {kill_s:.2} s"));
    let end_ns = [
        trace.scans.last().map(|scan| scan.scan_time_ns),
        trace.samples.last().map(|sample| sample.scan_time_ns),
        trace.tokens.last().map(|token| token.time_ns),
    ];
    if end_ns.iter().any(|end| end.is_none_or(|end| end <= outage.kill.at_ns)) {
        return page.paragraph("The recording ends before this kill and shows nothing of it.");
    }
    let trip = outage.trip_ms.unwrap_or(20.0);
    let range_ms = (-(trip.max(10.0)), trip * 2.0 + 10.0);
    let view = KillView { trace, outage, name, range_ms };
    let cause = TripCause::from_code(outage.cause).unwrap_or(TripCause::None);
    let why = match process {
        Process::Acquisition => {
            "While acquisition is dead, no process writes to the DAC, which holds its last value \
                as a real card does. The watchdog stops toggling the enable line, and the card \
                itself removes power from the motor."
        }
        _ => {
            "Commands end with the kill. The gate in acquisition writes 0 V when the last command \
                has expired."
        }
    };
    page.paragraph(&outage_text(outage, process, cause))
        .figure(&view.volts(), why)
        .figure(&view.states(), STATES)
        .figure(
            &view.recovery(shown),
            "The movement around the kill. The trip ends the protocol, which starts again once \
                power is enabled.",
        )
}

const STATES: &str = "Solid: state of the watchdog, from its tokens (4 tripped, 3 enabled, 2 \
    armed, 1 disarmed, 0 faulted). Dashed: state of the gate, from the samples (2 latched closed, \
    1 open, 0 closed).";

impl KillView<'_> {
    /// Axes over the time since the kill.
    fn axes(&self, what: &str, y_label: &str, height: u32) -> Figure {
        Figure::new(format!("{}, {what}", self.name), "time since the kill / ms", y_label)
            .size(WIDTH, height)
            .x_range(self.range_ms.0, self.range_ms.1)
    }

    /// What lies in the range of the figures and 1 ms beyond, over the time since the kill (ms).
    fn within(&self, values: impl Iterator<Item = (u64, f64)>) -> impl Iterator<Item = (f64, f64)> {
        let (at_ns, (from, until)) = (i128::from(self.outage.kill.at_ns), self.range_ms);
        values
            .map(move |(time_ns, value)| ((i128::from(time_ns) - at_ns) as f64 * 1e-6, value))
            .filter(move |(at, _)| *at >= from - 1.0 && *at <= until + 1.0)
    }

    /// Volts around the kill: commanded, held by the DAC, at the motor.
    fn volts(&self) -> Figure {
        let scans = || self.trace.scans.iter();
        let motor = self.within(scans().map(|scan| (scan.scan_time_ns, scan.motor_v[0])));
        let dac = self.within(scans().map(|scan| (scan.scan_time_ns, scan.dac_v[0])));
        let commands = self.trace.commands.iter();
        let commands = self.within(commands.map(|command| (command.time_ns, command.volts[0])));
        let ((motor_x, motor_y), (dac_x, dac_y)) = (stairs(motor), stairs(dac));
        let (command_x, command_y): (Vec<f64>, Vec<f64>) = commands.unzip();
        let volts = self
            .axes("volts", "volts / V", 280)
            .scatter(Orange, "command", &command_x, &command_y)
            .dashed(Sky, "held by the DAC", &dac_x, &dac_y)
            .line(Vermillion, "at the motor", &motor_x, &motor_y)
            .vertical(Grey, "killed", 0.0);
        match self.outage.trip_ms {
            Some(trip) => volts.vertical(Green, format!("0 V after {trip:.1} ms"), trip),
            None => volts,
        }
    }

    fn states(&self) -> Figure {
        let tokens = self.trace.tokens.iter();
        let (watchdog_x, watchdog_y) =
            stairs(self.within(tokens.map(|token| (token.time_ns, f64::from(token.state)))));
        // The gate acts when the sample is published, not when the card took the scan.
        let samples = self.trace.samples.iter();
        let gates = samples.map(|sample| (sample.time_ns, f64::from(sample.gate_state)));
        let (gate_x, gate_y) = stairs(self.within(gates));
        self.axes("states", "state", 180)
            .y_range(-0.3, 4.3)
            .line(Blue, "watchdog", &watchdog_x, &watchdog_y)
            .dashed(Green, "gate", &gate_x, &gate_y)
            .vertical(Grey, "killed", 0.0)
    }

    /// The movement from a second before the kill until two seconds after power is back.
    fn recovery(&self, shown: &DisplayUnit) -> Figure {
        let (trace, outage) = (self.trace, self.outage);
        let kill_s = trace.seconds(outage.kill.at_ns);
        let back_ms = outage.powered_ms.or(outage.restart_ms).unwrap_or(1000.0);
        let (from_s, until_s) = (kill_s - 1.0, kill_s + back_ms * 1e-3 + 2.0);
        let (time, reference) = reference(trace, shown, from_s, until_s);
        let (sample_time, samples): (Vec<f64>, Vec<&Sample>) = trace
            .samples
            .iter()
            .map(|sample| (trace.seconds(sample.scan_time_ns), sample))
            .filter(|(at, _)| *at >= from_s && *at <= until_s)
            .unzip();
        let of = |value: fn(&Sample) -> f64| shown.scale(samples.iter().map(|row| value(row)));
        let mut recovery = Figure::new(
            format!("{}, back to the movement", self.name),
            "time / s",
            format!("position / {}", shown.unit),
        )
        .size(WIDTH, 280)
        .x_range(from_s, until_s)
        .dashed(Grey, "reference", &time, &reference)
        .line(Blue, "master", &sample_time, &of(master))
        .line(Vermillion, "slave", &sample_time, &of(slave))
        .vertical(Grey, "killed", kill_s);
        for (colour, name, at_ms) in [
            (Green, "process back", outage.restart_ms),
            (Purple, "enabled by the operator", outage.enabled_ms),
        ] {
            if let Some(at_ms) = at_ms {
                recovery = recovery.vertical(colour, name, kill_s + at_ms * 1e-3);
            }
        }
        recovery
    }
}

fn outage_text(outage: &Outage, process: Process, cause: TripCause) -> String {
    let mut text = format!(
        "The {process} process was killed with {:.2} V at the motor. ",
        outage.volts_before
    );
    match outage.trip_ms {
        Some(trip) => {
            text += &format!("The motor was at 0 V after {trip:.1} ms and stayed there. ")
        }
        None => text += "The motor was not at 0 V until power was enabled again. ",
    }
    if let Some(tripped) = outage.tripped_ms {
        text += &format!("The watchdog tripped after {tripped:.1} ms ({cause}). ");
    }
    match outage.restart_ms {
        Some(back) => {
            text += &format!("The restarted {process} process published after {back:.0} ms. ")
        }
        None => text += &format!("No restarted {process} process published. "),
    }
    if let Some(powered) = outage.powered_ms {
        text += &format!(
            "After reset, arm and enable, the motor had voltage again {:.2} s after the kill.",
            powered * 1e-3
        );
    }
    text
}

fn model(page: Page, model: &Model, summary: &Summary, shown: &DisplayUnit) -> Page {
    let mut page = page.heading("Measurement and declared model").paragraph(
        "The declared plant, with the hand model of the rig file and no effect, was simulated in \
            open loop: its input is the recorded motor voltage, its initial state the first \
            samples, and nothing corrects it towards the measurement. A small difference in where \
            dry friction stops the handle therefore grows from movement to movement. The error \
            measures the prediction over the whole run, not over one second of it. Here the rig is \
            itself simulated with the same equations; without an added effect only the resolution \
            and noise of the sensors remain.",
    );
    if let Some(effect) = &summary.injected {
        page = page.paragraph(&format!(
            "The simulated plant contained {effect}, which the declared model lacks; part of the \
                error is due to it."
        ));
    }
    let mut table =
        Table::new(["channel", "unit", "error, rms", "signal, rms", "error / signal, %"]);
    for channel in &model.channels {
        let (factor, label) = match channel.unit {
            "rad" => (shown.factor, format!("position / {}", shown.unit)),
            unit => (1.0, format!("torque / {unit}")),
        };
        let scaled =
            |values: &[f64]| values.iter().map(|value| value * factor).collect::<Vec<f64>>();
        let figure = Figure::new(channel.name, "time / s", label)
            .size(WIDTH, 240)
            .line(Blue, "measured", &model.time_s, &scaled(&channel.measured))
            .dashed(Vermillion, "declared model", &model.time_s, &scaled(&channel.declared));
        page = page.figure(
            &figure,
            &format!("{}: rms error {:.4} {}.", channel.name, channel.error, channel.unit),
        );
        table = table.row([
            channel.name.to_owned(),
            channel.unit.to_owned(),
            format!("{:.4}", channel.error),
            format!("{:.4}", channel.size),
            if channel.size > 0.0 {
                format!("{:.1}", 100.0 * channel.error / channel.size)
            } else {
                "–".to_owned()
            },
        ]);
    }
    page.table(table, "Simulation error of the declared model, by channel.")
}

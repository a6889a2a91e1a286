//! Runs the demo: from the command line to the recording, the page and the summary.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use anyhow::{Context as _, bail};
use ipc_types::{CardKind, Process, Profile};
use operator::{CardOptions, Cleaning, UpOptions};
use plant::effects::Effect;
use rig::protocol::Protocol;
use rig::{load_protocol, load_rig};
use runtime::RigName;
use tune::Protocols;

use crate::analysis::{Analysis, Trace, analyse};
use crate::closed_loop::{ClosedLoop, Closing};
use crate::demonstrated::Run;
use crate::folder::Folder;
use crate::hidden_effect::draw;
use crate::page::page;
use crate::session::{Interrupted, Session};
use crate::terminal::Terminal;
use crate::{IdentifyResult, Outcome, Summary};

/// Shortest guided movement with room for two kills and what follows them (s).
const SHORTEST_S: f64 = 14.0;
const LONGEST_S: f64 = 600.0;
/// The guided movement among the protocol's segments.
const GUIDED: usize = 1;
/// Signals that end the demo.
const SIGNALS: [i32; 3] =
    [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM, signal_hook::consts::SIGHUP];
/// When within the guided movement the kills come, as a part of it.
const KILLS: [(Process, f64); 2] = [(Process::Control, 0.15), (Process::Acquisition, 0.35)];

/// Brings a simulated rig up whose machine has an effect that no model is told of, moves it, kills
/// two of its processes, finds the effect in the recording, adds it to the model, and tunes the
/// control by it.
///
/// In the middle of a guided movement control is killed with SIGKILL, later acquisition; each time
/// the motor loses power, the launcher starts the process again, the operator's verbs (reset, arm,
/// enable) bring power back, and the protocol, which the trip ended, is started anew. Then a
/// movement and an excitation are recorded, `farreach identify` reports what the declared model
/// lacks, a rig file with that effect and the control that follows best with it is written, the rig
/// goes on with this file, and the movement is played again: errors of model and handle before and
/// after, on one page. Needs no root, no systemd and no hardware; nothing is left running.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:\n  farreach demo\n  farreach demo --seed 7 --out /tmp/demo\n  \
        farreach demo --effect backlash@slave=0.05\n\n\
    Writes report.html, summary.json, run.mcap, before.mcap, excitation.mcap, after.mcap and \
    rig.toml. Exit codes: 0 all requirements met, 1 a \
    requirement was not met or the run failed, 2 usage, 3 data was lost")]
pub struct Args {
    /// Folder for the results; those of an earlier demo are replaced, nothing else is
    #[arg(long, value_name = "DIR", default_value = "farreach-demo")]
    pub out: PathBuf,
    /// Length of the guided movement in s, from 14 on; 14 unless given
    #[arg(long, value_name = "N", value_parser = seconds)]
    pub seconds: Option<f64>,
    /// The effect that is hidden in the simulated machine, in place of one that is drawn
    #[arg(long, value_name = "ID[@SITE][=SIZE]|none")]
    pub effect: Option<String>,
    /// Draws the hidden effect and its size; the time of day, unless given
    #[arg(long, value_name = "N", conflicts_with = "effect")]
    pub seed: Option<u64>,
    /// Rig file, or the name of one that comes with farreach; its model must be one that can be
    /// simulated
    #[arg(long, value_name = "FILE|NAME", default_value = "hydrostatic")]
    pub rig: PathBuf,
    /// Leaves out all that follows the kills: nothing is hidden, identified or tuned
    #[arg(long)]
    pub no_identify: bool,
}

fn seconds(text: &str) -> Result<f64, String> {
    let seconds: f64 = text.parse().map_err(|_| "expected a number of seconds".to_owned())?;
    if (SHORTEST_S..=LONGEST_S).contains(&seconds) {
        Ok(seconds)
    } else {
        Err(format!(
            "expected {SHORTEST_S} to {LONGEST_S} s: two kills and what follows them must fit in"
        ))
    }
}

/// Runs the demo. Returns the exit code: 0 all requirements met, 3 data was lost, 1 not met or
/// the run was interrupted.
///
/// # Errors
/// When the run could not be made: what is wrong with the files, which process did not come up.
pub fn run(args: Args, revision: &str) -> anyhow::Result<i32> {
    let begun = Instant::now();
    let hidden = match hidden(&args) {
        Ok(hidden) => hidden,
        Err(error) => {
            eprintln!("farreach: --effect: {error}");
            return Ok(operator::USAGE);
        }
    };
    let effect = hidden.as_deref();
    let rig = load_rig(&args.rig)?;
    let protocol = protocol(args.seconds)?;
    protocol.check_against(&rig)?;
    let movements = Protocols::usual(&rig)?;
    let folder = Folder::prepare(&args.out)?;
    let stop = runtime::stop_on(&SIGNALS)?;
    let terminal = Terminal::new();
    let plan = Plan { args: &args, protocol: &protocol, movements: &movements, folder: &folder };
    let run = match run_session(&plan, effect, revision, &terminal, &stop) {
        Ok(run) => run,
        Err(error) if error.is::<Interrupted>() => {
            terminal
                .warn("interrupted: the rig is down, nothing is left running; no report was made");
            return Ok(operator::FAILED);
        }
        Err(error) if folder.recording().exists() => {
            return Err(error.context(format!(
                "the run was aborted; the recording so far is in {}",
                folder.recording().display()
            )));
        }
        Err(error) => return Err(error),
    };
    terminal.progress("reading the recording, running the declared model");
    let trace = Trace::read(&folder.recording())?;
    let analysis = analyse(trace, &run.kills, &rig)?;
    let mut outcome = Outcome::of(&analysis);
    if folder.further_parts() {
        outcome =
            outcome.with_lost("the logger was restarted: the recording is in parts".to_owned());
    }
    let summary = Summary::new(&analysis, effect)
        .with_identify(&run.identified)
        .with_closed_loop(&run.closed_loop, effect);
    let html = page(&analysis, &summary, &outcome, &run, &rig)?;
    let json = serde_json::to_string_pretty(&summary)? + "\n";
    let unwritten = [(folder.page(), html), (folder.summary(), json)]
        .into_iter()
        .filter_map(|(path, text)| write(&path, &text).err())
        .map(|error| format!("{error:#}"));
    // On a full disk the page cannot be written either; the numbers are still printed.
    outcome = unwritten.fold(outcome, Outcome::with_lost);
    print_summary(&terminal, &analysis, &summary, &outcome, &run);
    // What could not be written is named above.
    for file in folder.files().into_iter().filter(|file| file.exists()) {
        terminal.print(&file.display().to_string());
    }
    terminal.print(&format!("{:.0} s in all", begun.elapsed().as_secs_f64()));
    Ok(outcome.exit_code())
}

/// The effect that is hidden, as `ID@SITE=SIZE`; `None` for none.
fn hidden(args: &Args) -> Result<Option<String>, plant::effects::EffectError> {
    match args.effect.as_deref() {
        Some("none" | "") => Ok(None),
        Some(text) => plant::effects::parse(text).map(|effect| Some(full_name(effect.as_ref()))),
        None if args.no_identify => Ok(None),
        None => {
            let seed = args.seed.unwrap_or_else(|| runtime::clock::now_ns() / 1_000_000_000);
            println!("an effect is hidden in the machine, drawn with --seed {seed}");
            Ok(Some(draw(seed)))
        }
    }
}

/// What is played, and where to.
struct Plan<'a> {
    args: &'a Args,
    protocol: &'a Protocol,
    movements: &'a Protocols,
    folder: &'a Folder,
}

/// `ID@SITE=SIZE`, with the site and the size that were taken where none was given.
fn full_name(effect: &dyn Effect) -> String {
    let size = effect.infos().first().and_then(|info| effect.get(info.name));
    let size = size.map_or_else(String::new, |size| format!("={size:?}"));
    format!("{}@{}{size}", effect.id(), effect.site().name())
}

/// Writes a file whole or not at all.
fn write(path: &std::path::Path, text: &str) -> anyhow::Result<()> {
    files::replace(path, text).with_context(|| format!("{}: cannot be written", path.display()))
}

/// The embedded protocol, its guided movement as long as asked.
fn protocol(seconds: Option<f64>) -> anyhow::Result<Protocol> {
    let overrides: Vec<String> =
        seconds.iter().map(|s| format!("segments.{GUIDED}.duration_s={s:?}")).collect();
    Ok(load_protocol("demo".as_ref(), &overrides)?)
}

/// When the kills come, in seconds of the protocol.
fn kill_times(protocol: &Protocol) -> anyhow::Result<Vec<(Process, f64)>> {
    let durations: Vec<f64> =
        protocol.sequence().map(|(_, segment)| segment.movement.duration_s()).collect();
    let Some(&guided) = durations.get(GUIDED) else {
        bail!("{}: no guided movement", protocol.file_name())
    };
    let before: f64 = durations[..GUIDED].iter().sum();
    Ok(KILLS.iter().map(|(process, part)| (*process, before + part * guided)).collect())
}

/// Brings the rig down whatever happens.
struct Guard {
    name: RigName,
    down: bool,
}

impl Guard {
    fn down(&mut self) -> Result<operator::Down, operator::Error> {
        self.down = true;
        operator::down(&self.name)
    }
}

impl Drop for Guard {
    fn drop(&mut self) {
        if !self.down
            && let Err(error) = operator::down(&self.name)
        {
            eprintln!(
                "error: the rig {} could not be brought down: {error}; try: farreach --rig-name {} \
                    down",
                self.name, self.name
            );
        }
    }
}

/// Brings the rig up, plays the protocol with its kills, closes the loop, and brings the rig down.
fn run_session(
    plan: &Plan<'_>,
    effect: Option<&str>,
    revision: &str,
    terminal: &Terminal,
    stop: &AtomicBool,
) -> anyhow::Result<Run> {
    let (args, folder) = (plan.args, plan.folder);
    let name: RigName = format!("demo-{}", std::process::id()).parse()?;
    let options = UpOptions {
        rig_name: name.clone(),
        rig: args.rig.clone(),
        card: Some(CardOptions::of(CardKind::Simulated)),
        effects: Vec::new(),
        machine: None,
        record: Some(folder.recording()),
        console: None,
        monitor: false,
        profile: None,
        placement: false,
        phases: operator::PhaseSource::File,
        executable: std::env::current_exe().context("cannot find the farreach executable")?,
    };
    terminal.progress("starting all processes");
    let begun = Instant::now();
    let mut guard = Guard { name, down: false };
    let up = operator::up(&options)?;
    let processes = up.running.status.units.len();
    terminal.print(&format!(
        "rig {} is up: {processes} processes after {:.1} s, {} timing, recording from the first \
            sample",
        guard.name,
        begun.elapsed().as_secs_f64(),
        up.profile
    ));
    if up.profile == Profile::BestEffort {
        terminal.warn(
            "best-effort timing: loops may wake up some ms late, and tokens and commands expire \
                after 40 ms instead of 5, so that a killed process is detected later (see \
                `farreach up --help`, --profile)",
        );
    }
    let mut session = Session::open(&up, terminal, stop, effect)?;
    let done = session.play(plan.protocol, &kill_times(plan.protocol)?)?;
    let written = session.finish()?;
    terminal.print(&format!("recording ended, {written} messages"));
    let (mut identified, mut closed_loop) = (IdentifyResult::Skipped, ClosedLoop::Skipped);
    if !args.no_identify {
        let movements = plan.movements;
        let closing = Closing { up: &up, folder, terminal, movements, revision };
        closed_loop = closing.close(&mut session, &mut identified)?;
    }
    drop(session);
    terminal.progress("stopping all processes");
    let down = guard.down()?;
    if down.cleaning == Cleaning::InUse {
        terminal.warn(&format!(
            "the rig's shared memory is still in use (a probe?): {}",
            guard.name.directory().display()
        ));
    }
    let killed =
        down.stopped.iter().flat_map(|report| &report.units).filter(|unit| unit.killed).count();
    terminal.print(&match killed {
        0 => "rig is down, motor first; its shared memory is removed".to_owned(),
        count => format!("rig is down; {count} processes had to be killed"),
    });
    if !done.unprovoked.is_empty() {
        terminal.warn(&format!(
            "{} trips that no kill explains: safe, but the host is too busy for this timing; the \
                page lists them",
            done.unprovoked.len()
        ));
    }
    Ok(Run { kills: done.kills, hidden: effect.map(str::to_owned), identified, closed_loop })
}

/// Prints the results.
fn print_summary(
    terminal: &Terminal,
    analysis: &Analysis,
    summary: &Summary,
    outcome: &Outcome,
    run: &Run,
) {
    let mut lines = vec![String::new()];
    let rates: Vec<String> = summary.command_hz.iter().map(|hz| format!("{hz:.2}")).collect();
    lines.push(format!(
        "samples     {} on disk, {} lost, {} never acquired; {:.1} MB",
        summary.samples,
        summary.samples_lost,
        summary.samples_missed,
        summary.recording_bytes as f64 * 1e-6
    ));
    lines.push(format!("control     {} Hz, by incarnation", rates.join(" and ")));
    let (late, answer) = (summary.wake_late_us.worst, summary.sample_to_command_us);
    lines.push(format!(
        "woke late   p50 {:.0}, p99 {:.0}, max {:.0} µs (worst process)",
        late.p50, late.p99, late.max
    ));
    lines.push(format!(
        "to command  p50 {:.0}, p99 {:.0}, max {:.0} µs from the scan",
        answer.p50, answer.p99, answer.max
    ));
    let by_process = summary.cycle_us.by_process.iter();
    let cycles: Vec<String> = by_process
        .map(|(process, time)| format!("{process} {:.0}/{:.0}", time.p50, time.p99))
        .collect();
    lines.push(format!("a cycle     p50/p99 {} µs", cycles.join(", ")));
    for outage in &analysis.outages {
        let after = |what: &str, value: Option<f64>| match value {
            Some(ms) => format!("{what} after {ms:.1} ms"),
            None => format!("{what}: not in the recording"),
        };
        lines.push(format!(
            "{:<11} killed at {:.1} V: {}, {}, {}",
            outage.kill.process.text(),
            outage.volts_before,
            after("0 V", outage.trip_ms),
            after("back", outage.restart_ms),
            after("volts again", outage.powered_ms)
        ));
    }
    if let Some(model) = &analysis.model {
        let channels = model.channels.iter();
        let errors: Vec<String> =
            channels.map(|c| format!("{} {:.4} {}", c.name, c.error, c.unit)).collect();
        lines.push(format!("model       rms error, free-running: {}", errors.join(", ")));
    }
    lines.extend(run.closed_loop.lines(run.hidden.as_deref()));
    lines.push(String::new());
    let busy = match analysis.unprovoked.len() {
        0 => "",
        _ => "; the host was too busy for an uninterrupted movement",
    };
    lines.push(match outcome {
        Outcome::Kept => format!("all requirements met{busy}"),
        Outcome::DataLost(reasons) => format!("DATA LOST: {}", reasons.join("; ")),
        Outcome::Broken(reasons) => format!("REQUIREMENT NOT MET: {}", reasons.join("; ")),
    });
    terminal.print(&lines.join("\n"));
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used)]

    use super::*;

    #[test]
    fn an_effect_is_named_with_the_site_and_size_that_were_taken() {
        let full = |text| full_name(plant::effects::parse(text).unwrap().as_ref());
        assert_eq!(full("backlash"), "backlash@line=0.001");
        assert_eq!(full("backlash@slave"), "backlash@slave=0.02");
        assert_eq!(full("backlash@slave=0.05"), "backlash@slave=0.05");
    }

    #[test]
    fn the_shortest_and_the_longest_movement_fit_the_rig() {
        let rig = load_rig("hydrostatic".as_ref()).unwrap();
        for seconds in [None, Some(SHORTEST_S), Some(LONGEST_S)] {
            let protocol = protocol(seconds).unwrap();
            protocol.check_against(&rig).unwrap();
            let victims = kill_times(&protocol).unwrap();
            assert_eq!(victims.len(), 2);
            // A kill ends the protocol, which then starts again: each kill needs only its own place
            // in the guided movement, after its fade-in and with time to wait for movement.
            let guided = seconds.unwrap_or(14.0);
            for (process, at) in victims {
                assert!(at > 2.0 && at + 4.0 < 1.0 + guided, "{process} at {at} s of {seconds:?}");
            }
        }
        assert!(seconds("5").is_err() && seconds("ten").is_err() && seconds("nan").is_err());
        assert_eq!(seconds("20"), Ok(20.0));
    }
}

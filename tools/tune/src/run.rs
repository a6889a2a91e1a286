//! `farreach tune`.

use std::io::{IsTerminal as _, Write as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::{Context as _, bail};
use identify::study::{StudyOptions, read, study};
use identify::write_rig::Provenance;
use indicatif::{ProgressBar, ProgressStyle};
use ipc_types::{LoggerRequest, Process, Verb};
use operator::RigLink;
use report::{Page, Tone};
use rig::{AxisUnit, RigFile};
use runtime::RigName;
use serde::Serialize;
use serde_json::Value;

use crate::live::{Bench, Movement};
use crate::page::section;
use crate::proposal::propose;
use crate::protocols::{self, Protocols};
use crate::since::{Since, compare_recordings};
use crate::tracking::TrackingError;
use crate::tuning::{Tuning, shown};

/// Signals that end the tuning.
const SIGNALS: [i32; 3] =
    [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM, signal_hook::consts::SIGHUP];

/// Tunes the control of a rig that is up, with nobody at the handle.
///
/// Plays a movement and measures how the handle follows it, plays an excitation, identifies from it
/// what the declared model lacks, simulates which options of the control follow best with that
/// model, and shows the rig file that it proposes with the predicted tracking error. If a person
/// agrees, the file is written, the rig goes on with it, and the movement is played again: the
/// tracking error before and after is that of the machine itself.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:\n  farreach tune --out tuned\n  farreach tune --since tuned \
    --out monday\n  farreach tune --protocol guided-1hz --set segments.0.amplitude_deg=20 --yes\n\n\
    Needs an armed rig that does not record. Writes before.mcap, excitation.mcap, report.html and \
    summary.json, and with the person's consent rig.toml and after.mcap. Exit codes: 0 done, 1 the \
    rig could not be tuned, 2 usage")]
pub struct Args {
    /// The movement that the handle is to follow, of 5 s or more: a protocol file, or the name of
    /// one shipped with farreach; 12 s of guided-1hz unless given
    #[arg(long, value_name = "FILE|NAME")]
    pub protocol: Option<PathBuf>,
    /// Overrides a value of that protocol before it is checked (repeatable)
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub overrides: Vec<String>,
    /// The movement from which the model is identified
    #[arg(long, value_name = "FILE|NAME", default_value = protocols::EXCITATION)]
    pub excitation: PathBuf,
    /// Folder for the results; it must not exist
    #[arg(long, value_name = "DIR", default_value = "farreach-tune")]
    pub out: PathBuf,
    /// Tunes nothing: tells whether the machine is still the one of an earlier tuning, whose folder
    /// this is. Ends with code 1 where it is not
    #[arg(long, value_name = "DIR", conflicts_with = "yes")]
    pub since: Option<PathBuf>,
    /// Takes the proposal without asking; for the simulated card alone
    #[arg(long)]
    pub yes: bool,
    /// Largest torque at the handle (N·m or N): more means that a hand holds it
    #[arg(long, value_name = "N", default_value_t = 1.0)]
    pub torque_limit: f64,
    /// Time limit of the identification (s)
    #[arg(long, value_name = "N", default_value_t = 180.0)]
    pub limit_s: f64,
    /// Prints the result as JSON
    #[arg(long)]
    pub json: bool,
}

/// Tunes a rig that is up. Returns the exit code.
///
/// # Errors
/// Why it could not be tuned. The rig then goes on with the rig file that it had, unless the error
/// says otherwise.
pub fn run(args: &Args, name: &RigName, revision: &str) -> anyhow::Result<i32> {
    let rig = operator::rig_of(name)?;
    check_rig(args, name, &rig)?;
    let protocols =
        Protocols::load(args.protocol.as_deref(), &args.overrides, &args.excitation, &rig)?;
    let stop = runtime::stop_on(&SIGNALS)?;
    let link = RigLink::open(name)?;
    check_state(&link)?;
    std::fs::create_dir(&args.out).with_context(|| {
        format!(
            "--out {}: expected a folder that does not exist and can be made",
            args.out.display()
        )
    })?;
    let bar = spinner();
    let mut progress = |text: &str| bar.set_message(text.to_owned());
    let mut bench = Bench {
        name,
        link: &link,
        stop: &stop,
        progress: &mut progress,
        torque_limit: args.torque_limit,
    };
    let unit = rig.axes.first().map_or(AxisUnit::Radian, |axis| axis.unit);
    let terminal = Terminal { bar: &bar, json: args.json, unit };
    if let Some(earlier) = &args.since {
        let compared = compared(args, earlier, &rig, &protocols, &mut bench);
        let disarmed = operator::verb(&link, Verb::Disarm);
        bar.finish_and_clear();
        let compared = compared?;
        disarmed?;
        return terminal.tell_since(&compared);
    }
    let tuned = tuned(args, &rig, &protocols, &mut bench, revision, &terminal);
    // Whatever came of it: nobody left the motor under power on purpose.
    let disarmed = operator::verb(&link, Verb::Disarm);
    bar.finish_and_clear();
    let tuning = tuned?;
    disarmed?;
    if args.json {
        writeln!(std::io::stdout(), "{}", serde_json::to_string_pretty(&tuning.summary())?)?;
    }
    Ok(operator::DONE)
}

/// From the first movement to the last.
fn tuned(
    args: &Args,
    rig: &RigFile,
    protocols: &Protocols,
    bench: &mut Bench<'_>,
    revision: &str,
    terminal: &Terminal<'_>,
) -> anyhow::Result<Tuning> {
    let mut tuning = identified(args, rig, protocols, bench, revision, terminal)?;
    terminal.say(&tuning.proposal_lines().join("\n"));
    terminal.say(&tuning.diff());
    if agreed(args, &tuning, bench.stop, terminal)? {
        let taken = take(args, rig, protocols, bench, &mut tuning);
        // What was found is written even where the last movement failed.
        write_results(args, &tuning)?;
        taken?;
        let after = tuning.after.as_ref().map_or(f64::NAN, |after| after.error.rms);
        terminal.say(&format!(
            "after       {} ({} before)",
            tuning.shown(after),
            tuning.shown(tuning.before.error.rms)
        ));
        terminal.say(&format!("the rig goes on with {}", args.out.join(RIG_FILE).display()));
    } else {
        write_results(args, &tuning)?;
        terminal.say("the proposal was not taken; the rig is as it was");
    }
    Ok(tuning)
}

const RIG_FILE: &str = "rig.toml";
const BEFORE: &str = "before.mcap";
const AFTER: &str = "after.mcap";
const EXCITATION: &str = "excitation.mcap";
const SUMMARY: &str = "summary.json";
/// How often the spinner turns.
const TICK: Duration = Duration::from_millis(120);

fn spinner() -> ProgressBar {
    let bar = ProgressBar::new_spinner();
    if let Ok(style) = ProgressStyle::with_template("{spinner} {wide_msg} {elapsed}") {
        bar.set_style(style);
    }
    bar.enable_steady_tick(TICK);
    bar
}

/// What can be said before anything moves.
fn check_rig(args: &Args, name: &RigName, rig: &RigFile) -> anyhow::Result<()> {
    if rig.axes.len() != 1 || !rig.model.kind.is_transmission() {
        bail!(
            "{}: expected a transmission of one axis, found {} axes and a model of kind \"{}\"; \
             tune several axes by hand, with `farreach identify --axis`",
            rig.file_name(),
            rig.axes.len(),
            rig.model.kind.name()
        );
    }
    let simulated = operator::running(name)?.has_unit(Process::Simulator.text());
    if args.yes && !simulated {
        bail!(
            "--yes: only a simulated rig goes on with another rig file and gets its power back \
             unattended; leave it out, and confirm at the terminal"
        );
    }
    if !args.yes && args.since.is_none() && !std::io::stdin().is_terminal() {
        bail!("expected a terminal at which a person confirms the proposal, or --yes");
    }
    Ok(())
}

/// Whether the rig is ready to be moved and recorded.
fn check_state(link: &RigLink) -> anyhow::Result<()> {
    if let Some(file) = link.logger(&LoggerRequest::Status)?.recording {
        bail!(
            "the rig records into {file} already, and tuning makes recordings of its own; end that \
             one (farreach rec stop) and tune again"
        );
    }
    Ok(operator::check_armed(link)?)
}

/// Plays and records movement and excitation; returns how the handle followed the one, and the
/// recording of the other.
fn recorded(
    args: &Args,
    protocols: &Protocols,
    bench: &mut Bench<'_>,
) -> anyhow::Result<(Movement, PathBuf)> {
    let followed = follow(args, protocols, bench, BEFORE)?;
    let excited = args.out.join(EXCITATION);
    bench.record(&protocols.excitation, &excited)?;
    Ok((followed, excited))
}

/// Plays and records the movement.
fn follow(
    args: &Args,
    protocols: &Protocols,
    bench: &mut Bench<'_>,
    file: &str,
) -> anyhow::Result<Movement> {
    let file = args.out.join(file);
    bench.record(&protocols.movement, &file)?;
    Movement::read(&file, &protocols.movement)
}

/// A machine of today beside that of an earlier tuning.
#[derive(Debug, Serialize)]
struct Compared {
    /// What the observers show.
    #[serde(flatten)]
    since: Since,
    /// Tracking error of today.
    tracking: TrackingError,
    /// The same when it was tuned (rad or m, root mean square); null where that was not measured.
    tracking_then: Option<f64>,
}

/// Plays movement and excitation, and compares them with those of an earlier tuning.
fn compared(
    args: &Args,
    earlier: &Path,
    rig: &RigFile,
    protocols: &Protocols,
    bench: &mut Bench<'_>,
) -> anyhow::Result<Compared> {
    let then = earlier.join(EXCITATION);
    // Before the rig moves for nothing.
    recording::mcap_read::Recording::open(&then)
        .context("--since: expected the folder of an earlier tuning")?;
    let (movement, excited) = recorded(args, protocols, bench)?;
    (bench.progress)("running the model along both excitations");
    let since = compare_recordings(rig, &then, &excited)?;
    let summary = std::fs::read(earlier.join(SUMMARY)).ok();
    let summary = summary.and_then(|text| serde_json::from_slice::<Value>(&text).ok());
    let tracking_then = summary.and_then(|summary| summary["after"]["rms"].as_f64());
    let compared = Compared { since, tracking: movement.error, tracking_then };
    let path = args.out.join(SUMMARY);
    files::replace(&path, serde_json::to_string_pretty(&compared)?)
        .with_context(|| format!("{}", path.display()))?;
    Ok(compared)
}

/// Movement, excitation, identification, proposal.
fn identified(
    args: &Args,
    rig: &RigFile,
    protocols: &Protocols,
    bench: &mut Bench<'_>,
    revision: &str,
    terminal: &Terminal<'_>,
) -> anyhow::Result<Tuning> {
    let unit = rig.axes.first().map(|axis| axis.unit).context("an axis")?;
    let (before, excited) = recorded(args, protocols, bench)?;
    (bench.progress)("identify: what does the declared model lack? Ctrl-C ends it");
    let record = read(&excited, rig)?;
    let options = StudyOptions { limit_s: Some(args.limit_s), ..StudyOptions::default() };
    let found = study(rig, &[record], options)?;
    found
        .page
        .footer(concat!("farreach tune ", env!("CARGO_PKG_VERSION")))
        .write(args.out.join("identify.html"))?;
    (bench.progress)("simulating the control with the model that was identified");
    let provenance = Provenance::today(revision);
    let proposal = propose(rig, &found.outcome, &protocols.movement, &provenance)?;
    let tuning = Tuning {
        unit,
        before,
        outcome: found.outcome,
        sentence: found.sentence,
        proposal,
        text_before: rig.text().to_owned(),
        after: None,
    };
    terminal.say(&format!(
        "before      {} rms over {}",
        tuning.shown(tuning.before.error.rms),
        protocols.movement.name
    ));
    Ok(tuning)
}

/// Asks the person.
fn agreed(
    args: &Args,
    tuning: &Tuning,
    stop: &AtomicBool,
    terminal: &Terminal<'_>,
) -> anyhow::Result<bool> {
    if stop.load(Ordering::Relaxed) {
        bail!("stopped; the rig is as it was");
    }
    if args.yes {
        return Ok(true);
    }
    let answer = terminal.ask(&format!(
        "Write {}, have the rig go on with it, and play the movement again ({} predicted)? The \
         motor gets power. [y/N] ",
        args.out.join(RIG_FILE).display(),
        tuning.shown(tuning.proposal.control.error.rms)
    ))?;
    Ok(matches!(answer.trim(), "y" | "Y" | "yes"))
}

/// Writes the rig file, has the rig go on with it, and plays the movement again.
fn take(
    args: &Args,
    rig: &RigFile,
    protocols: &Protocols,
    bench: &mut Bench<'_>,
    tuning: &mut Tuning,
) -> anyhow::Result<()> {
    let proposed = &tuning.proposal.control.rig;
    if operator::rig_of(bench.name)?.identity() != rig.identity() {
        bail!("the rig file of the rig was changed meanwhile; nothing was written: tune again");
    }
    let path = args.out.join(RIG_FILE);
    files::create_new(&path, proposed.text())
        .with_context(|| format!("{}: cannot be written", path.display()))?;
    bench.change_rig_file(&path, proposed)?;
    let after = follow(args, protocols, bench, AFTER)
        .with_context(|| format!("the rig goes on with {}", path.display()))?;
    tuning.after = Some(after);
    Ok(())
}

fn write_results(args: &Args, tuning: &Tuning) -> anyhow::Result<()> {
    let json = serde_json::to_string_pretty(&tuning.summary())?;
    let path = args.out.join(SUMMARY);
    files::replace(&path, &json).with_context(|| format!("{}", path.display()))?;
    let tone = match tuning.after {
        Some(ref after) if after.error.rms < tuning.before.error.rms => Tone::Good,
        Some(_) => Tone::Warning,
        None => Tone::Neutral,
    };
    let found = if tuning.outcome.effects.is_empty() {
        "No effect was found."
    } else {
        tuning.sentence.as_str()
    };
    let page = Page::new(format!("farreach tune: {}", tuning.proposal.control.rig.name)).verdict(
        tone,
        &tuning.sentence,
        found,
    );
    section(page, tuning)
        .details("summary.json", &json)
        .footer(concat!("farreach tune ", env!("CARGO_PKG_VERSION")))
        .write(args.out.join("report.html"))
}

/// Lines for a person, above the line that shows what is being done.
struct Terminal<'a> {
    bar: &'a ProgressBar,
    /// Whether standard output is for the result alone.
    json: bool,
    /// Unit of the positions.
    unit: AxisUnit,
}

impl Terminal<'_> {
    fn say(&self, text: &str) {
        self.bar.suspend(|| {
            if self.json {
                eprintln!("{text}");
            } else {
                // A closed pipe must not end the tuning.
                let _closed = writeln!(std::io::stdout(), "{text}");
            }
        });
    }

    /// Tells how today's machine compares; returns the exit code.
    fn tell_since(&self, compared: &Compared) -> anyhow::Result<i32> {
        let Compared { since, tracking, tracking_then } = compared;
        let text = since.sentence();
        let then = tracking_then.map_or(String::new(), |then| {
            format!("; {} when it was tuned", shown(self.unit, then))
        });
        self.say(&format!("{text}\ntracking    {} rms{then}", shown(self.unit, tracking.rms)));
        if self.json {
            writeln!(std::io::stdout(), "{}", serde_json::to_string_pretty(compared)?)?;
        }
        Ok(match since {
            Since::Same { .. } => operator::DONE,
            Since::Changed { .. } | Since::Unknown { .. } => operator::FAILED,
        })
    }

    fn ask(&self, question: &str) -> std::io::Result<String> {
        self.bar.suspend(|| {
            let mut err = std::io::stderr();
            write!(err, "{question}")?;
            err.flush()?;
            let mut answer = String::new();
            std::io::stdin().read_line(&mut answer)?;
            Ok(answer)
        })
    }
}

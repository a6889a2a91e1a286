//! `farreach doctor`: examines a machine, and the rig that runs on it, by doing what a rig does.
//!
//! `checks.rs` is the one list of checks. Each is a thin measurement and a pure judgement
//! (`fn judge(measured) -> Outcome`) with its limits as constants beside it. The report is kept
//! ([`runtime::MachineReport`]): the logger puts it into every recording, and the watchdog asks for
//! it before a real card is armed.

mod bench;
mod checks;
mod examination;
mod live;
mod machine;
mod outcome;
mod page;
mod table;

use std::io::{BufRead as _, IsTerminal as _, Write as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::Duration;

use anyhow::{Context as _, bail};
use indicatif::{ProgressBar, ProgressStyle};
use ipc_types::CardKind;
use operator::DOCTOR;
use runtime::{MachineReport, RigName, Verdict};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

use crate::bench::{Bench, Options};
use crate::examination::{Told, examine};
use crate::live::RunningRig;

/// How often the spinner turns.
const TICK: Duration = Duration::from_millis(120);

/// Examines this computer, and the rig if one is up, by doing what a rig does.
///
/// Real-time scheduling, locked memory, wake-up latency idle and under load, stalls of the host,
/// sleep states, governor, isolation, shared memory, disk, clock, unit files; of a rig that is up
/// the card's stream, the torque sensors' noise, the scanner's trigger; with --move also the enable
/// line, the directions of the encoders and the sign of the torque. Each check passes, warns, fails
/// or is skipped, with what was measured and what to do. The report is kept: it goes into every
/// recording, and `arm` on a real card wants one that is younger than a day.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:\n  farreach doctor\n  farreach doctor --json | \
    jq '.checks[] | select(.verdict == \"fail\")'\n  farreach doctor --trigger 10\n  \
    farreach doctor --list\n  \
    farreach up --simulate && farreach reset && farreach arm\n  \
    farreach run home && farreach doctor --move --yes\n\n\
    Run it as the user of the rig: what is granted depends on the user. Takes about 10 s, longer \
    with --move. Exit codes: 0 nothing failed, 1 something failed or could not be kept, 2 usage")]
pub struct Args {
    /// Also powers the motor and moves the handle a little: enable line, directions of the
    /// encoders, sign of the torque. Asks for consent at the terminal. A relaxed hand may rest on
    /// the handle, and shows the sign of the torque
    #[arg(long = "move")]
    pub may_move: bool,
    /// Takes the consent for granted; for the simulated card alone
    #[arg(long, requires = "may_move")]
    pub yes: bool,
    /// Waits up to so long for a pulse of the scanner (s)
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    pub trigger: Option<f64>,
    /// Examines nothing: prints each check with what it does, its limits, their source and the
    /// remedy
    #[arg(long, conflicts_with_all = ["may_move", "trigger", "json"])]
    pub list: bool,
    /// Folder of the recordings, whose disk is examined
    #[arg(long, value_name = "DIR", default_value = ".")]
    pub folder: PathBuf,
    /// Prints the report as JSON
    #[arg(long)]
    pub json: bool,
}

fn seconds(text: &str) -> Result<f64, String> {
    let number: f64 = text.parse().map_err(|_| "expected a number of seconds".to_owned())?;
    match number > 0.0 && number <= 3600.0 {
        true => Ok(number),
        false => Err("expected more than 0 and at most 3600 s".to_owned()),
    }
}

/// Examines, prints and keeps the report. Returns the exit code: 1 where a check failed.
///
/// # Errors
/// Where nobody has agreed to a movement, or the report cannot be kept or printed.
pub fn run(args: &Args, rig_name: &RigName, revision: &str) -> anyhow::Result<i32> {
    if args.list {
        std::io::stdout().write_all(page::listing().trim_start().as_bytes())?;
        return Ok(operator::DONE);
    }
    let stop = runtime::stop_on(&[SIGINT, SIGTERM, SIGHUP])?;
    let rig = RunningRig::join(rig_name);
    let may_move = match &rig {
        Ok(rig) if args.may_move => agreed(args, rig)?,
        _ => args.may_move,
    };
    let options = Options { folder: args.folder.clone(), trigger_s: args.trigger, may_move };
    let mut bench = Bench::new(&options, &stop, rig.map_err(|error| no_rig(rig_name, &error)));
    let kept = DOCTOR.path();
    let report = examined(args, &mut bench, rig_name, revision, kept.as_deref())?;
    let mut out = std::io::stdout();
    if args.json {
        writeln!(out, "{}", serde_json::to_string_pretty(&report)?)?;
    } else {
        writeln!(out, "{}", table::totals(&report))?;
    }
    if stop.load(Ordering::Relaxed) {
        // It says less than the one before.
        bail!("stopped; the report is not kept");
    }
    let Some(folder) = kept else {
        let variable = DOCTOR.variable;
        bail!("the report is not kept: there is no home; name a folder in {variable}");
    };
    let file = report.keep(&folder, rig_name).with_context(|| {
        format!("the report is not kept; name a folder of your own in {}", DOCTOR.variable)
    })?;
    if !args.json {
        writeln!(out, "report kept in {}", file.display())?;
    }
    Ok(if report.count(Verdict::Fail) > 0 { operator::FAILED } else { operator::DONE })
}

/// Why there is no rig, in words.
fn no_rig(name: &RigName, error: &operator::Error) -> String {
    match error {
        operator::Error::Domain(runtime::DomainError::NoKeeper(_)) => {
            format!("rig {name} is not up")
        }
        other => format!("rig {name} cannot be joined: {other}"),
    }
}

/// Makes the checks; prints each as it is done, and shows the one that is made on a terminal.
fn examined(
    args: &Args,
    bench: &mut Bench<'_>,
    rig_name: &RigName,
    revision: &str,
    kept: Option<&Path>,
) -> anyhow::Result<MachineReport> {
    let bar = ProgressBar::new_spinner();
    if let Ok(style) = ProgressStyle::with_template("{spinner} {wide_msg} {elapsed}") {
        bar.set_style(style);
    }
    bar.enable_steady_tick(TICK);
    let width = width();
    let mut failed = None;
    let mut out = std::io::stdout();
    let mut say = |text: String| {
        let written = bar.suspend(|| writeln!(out, "{text}"));
        if let Err(error) = written {
            failed = Some(error);
        }
    };
    let report = examine(bench, rig_name, revision, &mut |told| match told {
        Told::Begins(check) => bar.set_message(check.title),
        Told::Done(check) if !args.json => say(table::row(check, width)),
        Told::Done(_) => {}
        Told::SoFar(report) => {
            if let Some(folder) = kept {
                // A real card that finds no report refuses, and the check says so.
                let _kept = report.keep(folder, rig_name);
            }
        }
        Told::Headline(report) if !args.json => say(table::headline(report)),
        Told::Headline(_) => {}
    });
    bar.finish_and_clear();
    match failed {
        Some(error) => Err(error.into()),
        None => Ok(report),
    }
}

/// Columns of the terminal; unlimited in a pipe.
fn width() -> usize {
    let terminal = || terminal_size::terminal_size().map_or(80, |(width, _)| width.0.into());
    if std::io::stdout().is_terminal() { terminal() } else { usize::MAX }
}

/// Whether a person agrees that the motor gets power and the handle moves.
fn agreed(args: &Args, rig: &RunningRig) -> anyhow::Result<bool> {
    let real = rig.card().is_none_or(|card: CardKind| card.capabilities().real);
    if args.yes {
        if real {
            bail!(
                "--yes: only a simulated rig is moved unattended; leave it out, and confirm at the \
                 terminal"
            );
        }
        return Ok(true);
    }
    if !std::io::stdin().is_terminal() {
        bail!("--move: expected a terminal at which a person agrees, or --yes on a simulated card");
    }
    eprint!(
        "The motor gets power, and each homed axis moves to and fro by 5 % of its range. The way \
         is clear, and a person is at the emergency stop? [y/N] "
    );
    std::io::stderr().flush()?;
    let mut answer = String::new();
    std::io::stdin().lock().read_line(&mut answer).context("read the answer")?;
    Ok(matches!(answer.trim(), "y" | "Y" | "yes"))
}

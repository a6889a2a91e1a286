//! Executes `reset`, `arm`, `enable`, `disarm`, `estop`, `run`, `stop` and the recording commands.

use std::env::var;
use std::io::Write;
use std::path::Path;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};
use ipc_types::{ExperimentAnswer, LoggerAnswer, LoggerRequest, PulseSource, Split, Verb};
use runtime::{DomainError, RigName};
use serde_json::json;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

use super::{RunArguments, print, print_json};
use crate::kept_folder::absolute;
use crate::run::causes;
use crate::scanner_key::ScannerKey;
use crate::{
    ChosenProtocol, ConsoleAddress, DATA_LOST, DONE, Error, FAILED, Progress, RigLink, RunOutcome,
    SessionFiles,
};

pub(super) fn link(rig_name: &RigName) -> Result<RigLink, Error> {
    RigLink::open(rig_name).map_err(|error| match error {
        Error::Domain(DomainError::NoKeeper(_))
            if launch::status(&rig_name.run_directory()).is_err() =>
        {
            Error::NotUp(rig_name.to_string())
        }
        other => other,
    })
}

pub(super) fn verb(rig_name: &RigName, verb: Verb, as_json: bool) -> anyhow::Result<i32> {
    let answer = link(rig_name)?.verb(verb)?;
    if !answer.done && !as_json {
        return Err(Error::Refused { verb, reason: answer.reason, state: answer.state }.into());
    }
    let value = json!({
        "verb": verb.text(),
        "done": answer.done,
        "state": answer.state,
        "reason": answer.reason,
    });
    print(as_json, value, &answer.state.to_string())?;
    Ok(if answer.done { DONE } else { FAILED })
}

/// Tells that a process is ready again, and after how long.
pub(super) fn restarted(process: &str, took: Duration, as_json: bool) -> anyhow::Result<i32> {
    let seconds = took.as_secs_f64();
    let value = json!({ "process": process, "ready_after_s": seconds });
    print(as_json, value, &format!("{process} is ready again, after {seconds:.2} s"))?;
    Ok(DONE)
}

pub(super) fn run(arguments: &RunArguments, rig_name: &RigName) -> anyhow::Result<i32> {
    let options = &arguments.options;
    // A wrong file is told without a rig.
    let chosen = (!options.continues).then(|| ChosenProtocol::new(options)).transpose()?;
    let stop = runtime::stop_on(&[SIGINT, SIGTERM, SIGHUP])?;
    let link = link(rig_name)?;
    let chosen = match chosen {
        Some(chosen) => chosen,
        None => ChosenProtocol::interrupted(&link, options)?,
    };
    let unrecorded =
        link.logger(&LoggerRequest::Status).is_ok_and(|logger| logger.recording.is_none());
    let mut files = match &options.mat {
        Some(name) => Some(SessionFiles::new(&link, &chosen, name)?),
        None => None,
    };
    let keys = (*chosen.pulses() == PulseSource::Key)
        .then(|| ScannerKey::start(rig_name, chosen.client()))
        .transpose()?;
    // Nothing is drawn where standard error is no terminal.
    let bar = ProgressBar::new(1000).with_style(ProgressStyle::with_template("{bar:40} {msg}")?);
    let mut told = false;
    let (mut ranges, mut scan, mut sessions) = (Vec::new(), None, None);
    let outcome = crate::run_protocol(&link, &chosen, &stop, &mut |progress| {
        if unrecorded && !told {
            eprintln!("nothing is being recorded (farreach rec start FILE)");
        }
        told = true;
        show(&bar, progress);
        ranges.clone_from(&progress.ranges);
        scan = progress.scan;
        sessions.clone_from(&progress.sessions);
        if let Some(files) = &mut files {
            files.see(progress.sessions.as_ref());
        }
    });
    bar.finish_and_clear();
    if let Some(uncounted) = keys.map(ScannerKey::finish).filter(|it| !it.reason.is_empty()) {
        eprintln!("{} keys were not counted: {}", uncounted.keys, uncounted.reason);
    }
    let completed = matches!(outcome, Ok(RunOutcome::Completed { .. }));
    let written = files.map_or_else(Vec::new, |files| files.finish(completed));
    let unwritten = written.iter().filter_map(|file| file.as_ref().err());
    unwritten.for_each(|error| eprintln!("{error:#}"));
    let incomplete = written.iter().any(Result::is_err);
    let written: Vec<_> = written.into_iter().filter_map(Result::ok).collect();
    let outcome = outcome?;
    let mut out = std::io::stdout();
    if arguments.json.json {
        let mut value = serde_json::to_value(&outcome)?;
        value["ranges"] = serde_json::to_value(&ranges)?;
        value["scan"] = serde_json::to_value(scan)?;
        value["sessions"] = serde_json::to_value(&sessions)?;
        value["files"] = serde_json::to_value(&written)?;
        print_json(&value)?;
    } else {
        for range in &ranges {
            writeln!(out, "{range}")?;
        }
        if let Some(scan) = &scan {
            writeln!(out, "{scan}")?;
        }
        if let Some(sessions) = &sessions {
            writeln!(out, "{sessions} (`farreach rec sessions` has them)")?;
        }
        for file in &written {
            writeln!(out, "{}", file.display())?;
        }
        tell(&mut out, &outcome)?;
    }
    Ok(match (completed, incomplete) {
        (true, false) => DONE,
        (true, true) => DATA_LOST,
        (false, _) => FAILED,
    })
}

pub(super) fn stop(rig_name: &RigName, as_json: bool) -> anyhow::Result<i32> {
    let stopped = crate::stop_protocol(&link(rig_name)?)?;
    let value = json!({
        "stopped": stopped.is_some(),
        "protocol": stopped.as_ref().map(|answer| &answer.name),
        "elapsed_s": stopped.as_ref().map(|answer| answer.elapsed_s),
    });
    let text = stopped.map_or_else(
        || "no protocol is running".to_owned(),
        |ExperimentAnswer { name, elapsed_s, .. }| {
            format!(
                "{name} stopped after {elapsed_s:.1} s; the handle comes to rest, the motor stays \
                 enabled at 0 V"
            )
        },
    );
    print(as_json, value, &text)?;
    Ok(DONE)
}

pub(super) fn console(rig_name: &RigName, as_json: bool) -> anyhow::Result<i32> {
    let address = ConsoleAddress::read(rig_name)?
        .ok_or_else(|| Error::NoConsole { rig: rig_name.to_string() })?;
    let (operator, subject) = (address.operator(), address.subject());
    let text = format!("operator  {operator}\nsubject   {subject}");
    print(as_json, json!({ "operator": operator, "subject": subject }), &text)?;
    Ok(DONE)
}

pub(super) fn start_recording(
    rig_name: &RigName,
    file: &Path,
    metadata: Vec<(String, String)>,
    split: Split,
    as_json: bool,
) -> anyhow::Result<i32> {
    let request = LoggerRequest::Start { path: absolute(file)?, metadata, split };
    let answer = accepted(link(rig_name)?.logger(&request)?)?;
    let value = json!({ "recording": answer.recording });
    print(as_json, value, &format!("recording {}", answer.recording.unwrap_or_default()))?;
    Ok(DONE)
}

pub(super) fn stop_recording(rig_name: &RigName, as_json: bool) -> anyhow::Result<i32> {
    let link = link(rig_name)?;
    let before = link.logger(&LoggerRequest::Status)?;
    let Some(file) = before.recording else {
        return Err(Error::Logger("nothing is being recorded".to_owned()).into());
    };
    let LoggerAnswer { written, lost, .. } = accepted(link.logger(&LoggerRequest::Stop)?)?;
    let value = json!({ "file": file, "written": written, "lost": lost });
    print(as_json, value, &format!("{file}: {written} messages, {lost} lost"))?;
    Ok(if lost > 0 { DATA_LOST } else { DONE })
}

pub(super) fn tag(
    rig_name: &RigName,
    text: String,
    author: Option<String>,
    as_json: bool,
) -> anyhow::Result<i32> {
    let author = author.unwrap_or_else(caller);
    let line = format!("{author}: {text}");
    let answer = accepted(link(rig_name)?.logger(&LoggerRequest::Tag { author, text })?)?;
    let file = answer.recording.unwrap_or_default();
    print(as_json, json!({ "recording": file, "tag": line }), &format!("{file}: {line}"))?;
    Ok(DONE)
}

/// The user who calls: whoever called sudo, which a rig of systemd may have taken.
fn caller() -> String {
    let mut names = ["SUDO_USER", "USER", "LOGNAME"].into_iter().filter_map(|name| var(name).ok());
    let found = names.find(|name| !name.is_empty());
    found.unwrap_or_else(|| format!("uid {}", rustix::process::getuid().as_raw()))
}

/// The logger's answer, unless it reports an error.
pub(super) fn accepted(answer: LoggerAnswer) -> Result<LoggerAnswer, Error> {
    if answer.error.is_empty() { Ok(answer) } else { Err(Error::Logger(answer.error)) }
}

fn tell(out: &mut dyn Write, outcome: &RunOutcome) -> std::io::Result<()> {
    match outcome {
        RunOutcome::Completed { elapsed_s } => {
            writeln!(
                out,
                "completed, {elapsed_s:.1} s; the motor is enabled at 0 V (farreach disarm removes \
                 its power)"
            )
        }
        RunOutcome::Stopped { elapsed_s } => {
            eprintln!(
                "farreach: stopped after {elapsed_s:.1} s; the handle comes to rest, the motor \
                 stays enabled at 0 V"
            );
            Ok(())
        }
        RunOutcome::Tripped { state, cause, faults } => {
            let mut text = format!("the protocol was stopped: the rig is {state}");
            for part in causes(*cause, faults) {
                text += &format!(", {part}");
            }
            eprintln!("farreach: {text}");
            Ok(())
        }
    }
}

fn show(bar: &ProgressBar, progress: &Progress) {
    let share = (progress.elapsed_s / progress.duration_s).clamp(0.0, 1.0);
    bar.set_position((share * 1000.0) as u64);
    let scan = progress.scan.map_or_else(String::new, |scan| format!(", {scan}"));
    let sessions = progress.sessions.as_ref();
    let sessions = sessions.map_or_else(String::new, |sessions| format!(", {sessions}"));
    let absent = if progress.absent { " (the experiment process is restarting)" } else { "" };
    bar.set_message(format!(
        "{:.1} of {:.1} s, segment {} of {} {}{sessions}{scan}{absent}",
        progress.elapsed_s,
        progress.duration_s,
        progress.segment,
        progress.segments,
        progress.label
    ));
}

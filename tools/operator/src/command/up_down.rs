//! Prints the results of `up` and `down`.

use std::io::Write;
use std::path::PathBuf;

use acquisition::CardOptions;
use ipc_types::{CardKind, Profile};
use launch::StopReport;
use runtime::RigName;
use serde_json::json;

use super::{UpArguments, print, print_json};
use crate::{Cleaning, ConsoleAddress, DONE, Down, Error, Up, UpOptions};

/// The price of the best-effort profile.
const BEST_EFFORT_COSTS: &str =
    "loops may wake some ms late, power is cut later, and only the simulated card is powered";
/// Why a rig does not run in real time.
const CHOSEN_BY_STALLS: &str = "because this computer stalls (--profile realtime overrides)";
const CHOSEN_BY_PERSON: &str = "as chosen (--profile, FARREACH_PROFILE)";
const NOT_GRANTED: &str = "because real-time scheduling is not granted (rtprio and memlock in \
                           /etc/security/limits.d grant it)";

pub(super) fn up(arguments: &UpArguments, rig_name: &RigName) -> anyhow::Result<i32> {
    if arguments.says_nothing() && launch::systemd::is_installed(rig_name.as_str()) {
        return up_under_systemd(rig_name, arguments.json.json);
    }
    let options = options(arguments, rig_name)?;
    let mut out = std::io::stdout();
    if arguments.foreground {
        let report = crate::up_in_foreground(&options, |rig, card| {
            eprintln!(
                "rig {rig_name} ({}, card {card}) runs in this terminal; Ctrl-C stops it",
                rig.name
            );
        })?;
        print_report(&mut out, &report)?;
        return Ok(DONE);
    }
    let up = crate::up(&options)?;
    let console = match options.console {
        Some(_) => ConsoleAddress::read(rig_name)?,
        None => None,
    };
    if arguments.json.json {
        print_json(&json_of(&up, console))?;
    } else {
        print_up(&mut out, &up, &options, console)?;
    }
    Ok(DONE)
}

/// Starts the installed rig of that name; all about it stands in /etc/farreach.
fn up_under_systemd(rig_name: &RigName, as_json: bool) -> anyhow::Result<i32> {
    let status = launch::systemd::start(rig_name.as_str())?;
    let processes = processes_of(&status);
    let names: Vec<_> = status.units.iter().map(|unit| unit.name.as_str()).collect();
    let text = format!(
        "rig {rig_name} is up, under systemd: {}\n  logs       journalctl -u \
         'farreach-*@{rig_name}'",
        names.join(", ")
    );
    let value = json!({
        "rig_name": rig_name.as_str(),
        "supervision": status.supervision,
        "processes": processes,
    });
    print(as_json, value, &text)?;
    Ok(DONE)
}

fn processes_of(status: &launch::Status) -> Vec<serde_json::Value> {
    let pid = |unit: &launch::UnitStatus| unit.process.map(|process| process.pid);
    let of_unit = |unit: &launch::UnitStatus| json!({ "name": unit.name, "pid": pid(unit) });
    status.units.iter().map(of_unit).collect()
}

fn options(arguments: &UpArguments, rig_name: &RigName) -> Result<UpOptions, Error> {
    let kind = match (arguments.card, &arguments.replay, arguments.simulate) {
        (Some(kind), ..) => Some(kind),
        (None, Some(_), _) => Some(CardKind::Replay),
        (None, None, simulate) => simulate.then_some(CardKind::Simulated),
    };
    let card = kind.map(|kind| CardOptions {
        kind,
        replay: arguments.replay.clone(),
        looped: arguments.loop_replay,
    });
    let executable = std::env::current_exe().map_err(|source| Error::Io {
        doing: "find the executable",
        path: PathBuf::from("/proc/self/exe"),
        source,
    })?;
    Ok(UpOptions {
        rig_name: rig_name.clone(),
        rig: arguments.rig.clone(),
        card,
        effects: arguments.effects.clone(),
        machine: arguments.machine.clone(),
        record: arguments.record.clone(),
        console: arguments.console,
        monitor: arguments.monitor,
        profile: arguments.profile,
        placement: arguments.place,
        phases: arguments.phases,
        executable,
    })
}

fn json_of(up: &Up, console: Option<ConsoleAddress>) -> serde_json::Value {
    json!({
        "rig_name": up.running.status.rig_name,
        "rig": up.rig.name,
        "rig_file": up.rig_file,
        "run_dir": up.running.run_dir,
        "backend": up.card,
        "profile": up.profile,
        "host_stall": up.host_stall,
        "wake_lateness": up.lateness,
        "session": format!("{:016x}", up.session),
        "launcher": up.running.launcher.pid,
        "processes": processes_of(&up.running.status),
        "console": console.map(|console| {
            json!({ "operator": console.operator(), "subject": console.subject() })
        }),
    })
}

fn print_up(
    out: &mut dyn Write,
    up: &Up,
    options: &UpOptions,
    console: Option<ConsoleAddress>,
) -> anyhow::Result<()> {
    let UpOptions { rig_name, record, .. } = options;
    let chosen = options.profile.or_else(runtime::realtime::chosen_profile);
    let names: Vec<_> = up.running.status.units.iter().map(|unit| unit.name.as_str()).collect();
    writeln!(
        out,
        "rig {rig_name} is up: {}, card {}, profile {}",
        up.rig.name, up.card, up.profile
    )?;
    writeln!(out, "  processes  {}", names.join(", "))?;
    writeln!(out, "  logs       {}", up.running.run_dir.display())?;
    if let Some(record) = record {
        writeln!(out, "  recording  {}", record.display())?;
    }
    if let Some(address) = console {
        writeln!(out, "  operator   {}", address.operator())?;
        writeln!(out, "  subject    {}", address.subject())?;
    }
    if let Some(stall) = up.host_stall {
        writeln!(out, "  stalls     {stall}, measured over {:?}", runtime::MEASURED_FOR)?;
    }
    if let Some(lateness) = &up.lateness {
        let us = |ns: u64| ns / 1000;
        let phases = &up.rig.phases;
        writeln!(
            out,
            "  phases     acquisition {} µs after the card, control {} µs: of bare wakes 99 of 100 \
             came within {} µs",
            us(phases.acquisition_ns - phases.simulator_ns),
            us(phases.control_ns - phases.simulator_ns),
            us(lateness.p99_ns)
        )?;
    }
    let option = match rig_name.as_str() {
        "farreach" => String::new(),
        name => format!(" --rig-name {name}"),
    };
    let next = if up.card.capabilities().accepts_output {
        "reset, arm, run PROTOCOL.toml; down ends it all"
    } else {
        "status"
    };
    writeln!(out, "  next       farreach{option} {next}")?;
    if up.profile == Profile::BestEffort {
        let too_slow = up.rig.missed_timeout(Profile::Realtime).map(|it| format!("because {it}"));
        let why = match up.host_stall {
            Some(stall) if stall.fifo => CHOSEN_BY_STALLS,
            None if chosen == Some(Profile::BestEffort) => CHOSEN_BY_PERSON,
            _ => too_slow.as_deref().unwrap_or(NOT_GRANTED),
        };
        eprintln!("profile best-effort {why}: {BEST_EFFORT_COSTS}");
    }
    Ok(())
}

pub(super) fn down(rig_name: &RigName, as_json: bool) -> anyhow::Result<i32> {
    let down = crate::down(rig_name)?;
    let mut out = std::io::stdout();
    if as_json {
        let value = json!({
            "rig_name": rig_name.as_str(),
            "disarmed": down.disarmed,
            "stopped": down.stopped,
            "removed": down.cleaning == Cleaning::Removed,
        });
        print_json(&value)?;
        return Ok(DONE);
    }
    print_down(&mut out, &down, rig_name)?;
    Ok(DONE)
}

fn print_down(out: &mut dyn Write, down: &Down, rig_name: &RigName) -> anyhow::Result<()> {
    match &down.stopped {
        None => writeln!(out, "rig {rig_name}: nothing was running")?,
        Some(report) => {
            if down.disarmed == Some(true) {
                writeln!(out, "the watchdog disarmed")?;
            } else {
                eprintln!("the watchdog did not answer `disarm`; stopping it removes motor power");
            }
            print_report(out, report)?;
        }
    }
    if down.cleaning == Cleaning::InUse {
        eprintln!(
            "a process of the rig that its launcher did not start is alive; its shared memory \
             stays in {}; end that process and run `farreach down` again",
            rig_name.directory().display()
        );
    }
    Ok(())
}

fn print_report(out: &mut dyn Write, report: &StopReport) -> anyhow::Result<()> {
    for unit in &report.units {
        let Some(exit) = &unit.exit else { continue };
        let killed = if unit.killed { ", KILLED: it did not end in time" } else { "" };
        writeln!(out, "stopped {:<12} {exit} after {} ms{killed}", unit.name, unit.took_ms)?;
    }
    for stray in &report.strays {
        writeln!(out, "stopped a stray process of the rig, {stray}")?;
    }
    writeln!(out, "rig {} is down", report.rig_name)?;
    Ok(())
}

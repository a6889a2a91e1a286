//! `farreach fault`: faults of the simulated card and machine.

use std::fmt::Write as _;

use clap::{Args, Subcommand};
use ipc_types::{InjectedFault, SimulatorAnswer, SimulatorRequest};
use runtime::RigName;
use serde_json::{Value, json};
use simulator::faults::{FaultKind, LIST};

use super::actions::link;
use super::{OutputFormat, print};
use crate::{DONE, Error};

/// `farreach fault`.
#[derive(Clone, Debug, Args)]
#[command(args_conflicts_with_subcommands = true, arg_required_else_help = true)]
pub struct FaultArguments {
    #[command(subcommand)]
    command: Option<FaultCommand>,
    /// The fault; `farreach fault list` shows the kinds
    #[arg(value_name = "KIND[@PLACE][=SIZE]")]
    fault: Option<String>,
    /// Axis, by name or by number from 0; the first, unless given
    #[arg(long, value_name = "AXIS")]
    axis: Option<String>,
    /// Ends the fault by itself after this time
    #[arg(long = "for", value_name = "SECONDS")]
    for_s: Option<f64>,
    #[command(flatten)]
    json: OutputFormat,
}

/// The other forms of `farreach fault`.
#[derive(Clone, Debug, Subcommand)]
pub enum FaultCommand {
    /// Changes the simulated machine while it moves: to that of the rig file with these effects in
    /// every axis, which no model is told of. Without any, tells those that it has
    #[command(after_help = "Examples:\n  farreach fault effect backlash@slave=0.05\n  \
        farreach fault effect none")]
    Effect {
        /// The effects; `none` for the machine of the rig file
        #[arg(value_name = "ID[@SITE][=SIZE]")]
        effects: Vec<String>,
        #[command(flatten)]
        #[allow(missing_docs)]
        json: OutputFormat,
    },
    /// Ends faults: all, or those named
    #[command(after_help = "Examples:\n  farreach fault clear\n  \
        farreach fault clear encoder_stuck@master")]
    Clear {
        /// The faults to end
        #[arg(value_name = "KIND[@PLACE]")]
        fault: Option<String>,
        /// On this axis only, by name or by number from 0
        #[arg(long, value_name = "AXIS")]
        axis: Option<String>,
        #[command(flatten)]
        #[allow(missing_docs)]
        json: OutputFormat,
    },
    /// Lists the kinds of faults, and those in force where a rig with the simulated card is up
    #[command(after_help = "Example:\n  farreach fault list")]
    List(OutputFormat),
}

pub(super) fn fault(rig_name: &RigName, arguments: FaultArguments) -> anyhow::Result<i32> {
    let FaultArguments { command, fault, axis, for_s, json: OutputFormat { json } } = arguments;
    match (command, fault) {
        (Some(FaultCommand::Effect { effects, json: OutputFormat { json } }), _) => {
            change_effects(rig_name, effects, json)
        }
        (Some(FaultCommand::Clear { fault, axis, json: OutputFormat { json } }), _) => {
            let answer = ask(rig_name, &SimulatorRequest::ClearFaults { fault, axis })?;
            tell(&answer.faults, "no fault is in force", json)
        }
        (None, Some(fault)) => {
            let answer = ask(rig_name, &SimulatorRequest::Fault { fault, axis, for_s })?;
            tell(&answer.faults, "", json)
        }
        (Some(FaultCommand::List(OutputFormat { json })), _) => list(rig_name, json),
        // Shows the help instead.
        (None, None) => list(rig_name, json),
    }
}

fn ask(rig_name: &RigName, request: &SimulatorRequest) -> Result<SimulatorAnswer, Error> {
    let answer = link(rig_name)?.simulator(request)?;
    if answer.error.is_empty() { Ok(answer) } else { Err(Error::Fault(answer.error)) }
}

/// Effects of the machine of the rig file.
const NO_EFFECT: &str = "none";

fn change_effects(rig_name: &RigName, effects: Vec<String>, as_json: bool) -> anyhow::Result<i32> {
    let request = match effects.as_slice() {
        [] => SimulatorRequest::Status,
        [one] if one == NO_EFFECT => SimulatorRequest::Effects { effects: Vec::new() },
        _ => SimulatorRequest::Effects { effects },
    };
    let answer = ask(rig_name, &request)?;
    let text = match answer.effects.as_slice() {
        [] => "the simulated machine is that of the rig file".to_owned(),
        effects => format!("effects of the simulated machine: {}", effects.join(", ")),
    };
    print(as_json, json!({ "effects": answer.effects }), &text)?;
    Ok(DONE)
}

fn tell(faults: &[InjectedFault], none: &str, as_json: bool) -> anyhow::Result<i32> {
    let lines: Vec<String> = faults.iter().map(InjectedFault::to_string).collect();
    let text = if lines.is_empty() { none.to_owned() } else { lines.join("\n") };
    print(as_json, json!({ "faults": faults }), &text)?;
    Ok(DONE)
}

fn list(rig_name: &RigName, as_json: bool) -> anyhow::Result<i32> {
    // The kinds are the same without a rig.
    let answer = ask(rig_name, &SimulatorRequest::Status).ok();
    let mut text = String::new();
    for kind in LIST {
        writeln!(text, "{}", usage(kind))?;
        writeln!(text, "    {}: {}", kind.acts, kind.what)?;
    }
    match &answer {
        None => text += "no simulated card runs",
        Some(answer) if answer.faults.is_empty() => text += "no fault is in force",
        Some(answer) => {
            text += "in force:";
            for fault in &answer.faults {
                write!(text, "\n    {fault}")?;
            }
        }
    }
    let kinds: Vec<Value> = LIST.iter().map(as_value).collect();
    let in_force = answer.map(|answer| answer.faults);
    print(as_json, json!({ "kinds": kinds, "in_force": in_force }), &text)?;
    Ok(DONE)
}

/// `encoder_jump[@master|slave][=SIZE]  SIZE: added once, in counts; 1000 unless given`.
fn usage(kind: &FaultKind) -> String {
    let mut text = kind.name.to_owned();
    if !kind.places.is_empty() {
        let places: Vec<_> = kind.places.iter().map(|place| place.word()).collect();
        text += &format!("[@{}]", places.join("|"));
    }
    if let Some(size) = kind.size {
        text += &format!("[=SIZE]  SIZE: {}, in {}; {}", size.what, size.unit, size.default);
        text += " unless given";
    }
    text
}

fn as_value(kind: &FaultKind) -> Value {
    let size = kind.size.map(|size| {
        json!({
            "what": size.what,
            "unit": size.unit,
            "default": size.default,
            "minimum": size.range.0,
            "maximum": size.range.1,
        })
    });
    json!({
        "name": kind.name,
        "acts": kind.acts.to_string(),
        "places": kind.places.iter().map(|place| place.word()).collect::<Vec<_>>(),
        "size": size,
        "what": kind.what,
        "after": kind.after,
    })
}

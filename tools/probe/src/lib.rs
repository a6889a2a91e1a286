//! `farreach probe`: looks into a running rig and never disturbs it. A probe only subscribes; a probe that is slow, is
//! stopped or dies costs nobody else anything.
//!
//! ```text
//! $ farreach probe echo command --count 2 --field sample_tick --field volts
//! sample_tick=17512 volts=[0.41,0,0]
//! sample_tick=17516 volts=[0.42,0,0]
//!
//! $ farreach probe echo sample --count 1 --json --field tick --field master_position[0]
//! {"fields":{"master_position[0]":0.0123,"tick":17520},"received_ns":8760123456,"topic":"sample"}
//!
//! $ farreach probe hz sample command --seconds 2
//! topic                 rate Hz   interval ms: mean        min        max        std    messages   lost
//! sample                 2000.1              0.500      0.488      0.561      0.004        4001      0
//! command                 500.0              2.000      1.987      2.044      0.006        1000      0
//! ```
//!
//! `delay` tells how long messages are under way, `top` shows all of it with the timing of the loops, `list` shows the
//! topics and their fields with units. stdout carries the result, stderr the diagnosis.

mod args;
mod attach;
mod echo;
mod fields;
mod list;
mod meter;
mod rates;
mod top;

use std::io::Write;

use runtime::RigName;

pub use args::Command;

/// Everything was done.
pub const DONE: i32 = 0;

/// Does what the command says, printing to stdout; returns the exit code.
///
/// # Errors
/// No such topic or field, no such rig, or a closed output.
pub fn run(command: Command, rig: &RigName) -> anyhow::Result<i32> {
    let mut out = std::io::stdout().lock();
    match command {
        Command::List { topic, json } => list::list(topic.as_deref(), json, &mut out),
        Command::Echo(args) => echo::echo(&args, rig, &mut out),
        Command::Hz(args) => rates::hz(&args, rig, &mut out),
        Command::Delay(args) => rates::delay(&args, rig, &mut out),
        Command::Top(args) => top::top(&args, rig, &mut out),
    }?;
    out.flush()?;
    Ok(DONE)
}

//! `farreach probe`: looks into a running rig and never disturbs it. A probe only subscribes; a
//! probe that is slow, is stopped or dies costs nobody else anything.
//!
//! ```text
//! $ farreach probe echo command --count 2 --field sample_tick --field volts
//! sample_tick=15299508 volts=[1.037822705272443,0,0]
//! sample_tick=15299512 volts=[1.2320877536413004,0,0]
//!
//! $ farreach probe echo sample --count 1 --json --field tick --field master_position[0]
//! {"fields":{"master_position[0]":0.05183627878423158,"tick":15299594},"received_ns":7649806954476,"topic":"sample"}
//!
//! $ farreach probe hz sample command --seconds 2
//! topic                  rate Hz   interval ms: mean        min        max        std    messages   lost
//! sample                  1999.9               0.500      0.001      1.819      0.042        4000      0
//! command                  500.0               2.000      0.715      3.286      0.065        1000      0
//!
//! $ farreach probe delay sample command --seconds 2
//! topic                 delay µs                    messages       p50       p99     p99.9       max
//! sample                published to received here      4001        28      1294      4030      5865
//! sample                scan to published               4001       122       173       610       737
//! command               published to received here      1001        27      1180      3932      5865
//! command               scan to published               1001       242       293       426       465
//! received here: this probe looks every 100 µs, which is part of the delay; scan to published is the rig's alone
//! ```
//!
//! `top` shows all of it with the timing of the loops, `list` the topics and their fields with
//! units. stdout carries the result, stderr the diagnosis.

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

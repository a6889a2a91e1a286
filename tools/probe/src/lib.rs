//! `farreach probe`: observes a running rig. A probe only subscribes: one that is slow, stopped or
//! killed does not disturb the rig. It ends when the rig goes down.
//!
//! ```text
//! $ farreach probe echo command --count 2 --field sample_tick --field volts
//! sample_tick=15299508 volts=[1.037822705272443,0,0]
//! sample_tick=15299512 volts=[1.2320877536413004,0,0]
//!
//! $ farreach probe echo sample --count 1 --json --field tick --field master_position[0]
//! {"fields":{"master_position[0]":0.0518362787,"tick":15299594},"received_ns":7649806954476,...
//!
//! $ farreach probe hz sample command --seconds 2
//! topic                rate Hz  mean ms      min      max      std messages  lost
//! sample                1999.9    0.500    0.001    1.819    0.042     4000     0
//! command                500.0    2.000    0.715    3.286    0.065     1000     0
//!
//! $ farreach probe delay command --seconds 2
//! topic                latency µs        messages     p50     p99   p99.9     max
//! command              to received here      1001      27    1180    3932    5865
//! command              scan to published     1001     242     293     426     465
//! to received here: from publishing to this probe, which polls every 100 µs
//! scan to published: within the rig
//! ```
//!
//! `top` shows all topics, the timing of the loops, and the model beside the machine where the
//! monitor runs, `list` the topics and their fields with units.

mod args;
mod attach;
mod echo;
mod fields;
mod list;
mod meter;
mod model_rows;
mod rates;
mod top;

use std::io::Write;

use runtime::RigName;

pub use args::Command;

/// Exit code: done.
pub const DONE: i32 = 0;

/// Runs the command and prints to standard output; returns the exit code.
///
/// # Errors
/// If the topic, the field or the rig does not exist, or the output is closed.
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

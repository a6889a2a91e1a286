//! `farreach probe`: observes a running rig, or reads a recording in the same way. A probe only
//! subscribes: one that is slow, stopped or killed does not disturb the rig. It ends when the rig
//! goes down.
//!
//! ```text
//! $ farreach probe echo command --count 2 --field sample_tick --field volts
//! sample_tick=15299508 volts=[1.037822705272443,0,0]
//! sample_tick=15299512 volts=[1.2320877536413004,0,0]
//!
//! $ farreach probe echo sample --once --format json --field tick --field master_position[0]
//! {"fields":{"master_position[0]":0.0518362787,"tick":15299594},"received_ns":7649806954476,...
//!
//! $ farreach probe echo sample --file run.mcap --every 0.5 --format csv --field tick | head -n 3
//! log_time_ns,tick
//! 1700000000500080000,1000
//! 1700000001000080000,2000
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
//!
//! $ farreach probe scope handle_torque --level 0.5 --out window.svg --timeout 60
//! window.svg: handle_torque rises to 0.5 N·m; 1 s, 2001 messages, 0 lost
//! ```
//!
//! `scope` without `--out` is an oscilloscope on the terminal. `top` shows all topics, the timing
//! of the loops, and the model beside the machine where the monitor runs, `list` the topics and
//! their fields with units, and `plot` the address of the console's live plots. `list`, `echo`,
//! `hz`, `delay` and `scope` also read a recording (`--file`). Exit code 3: a recording, or a
//! window that `scope` wrote, is not whole.

mod args;
mod attach;
mod echo;
mod fields;
mod list;
mod meter;
mod model_rows;
mod plot;
mod rates;
mod recorded;
mod scope;
mod source;
mod stream;
mod thinning;
mod top;

use std::io::Write;

use runtime::RigName;

pub use args::{Command, period};
pub use attach::{Attached, ns, topics};
pub use scope::channel;
pub use stream::{Arrived, Progress, Sent, Source, Stamp, Stream};
pub use thinning::Thinning;

/// Runs the command and prints to standard output; returns the exit code.
///
/// # Errors
/// If the topic, the field, the rig or the recording does not exist, or the output is closed.
pub fn run(command: &Command, rig: &RigName) -> anyhow::Result<i32> {
    run_to(command, rig, &mut std::io::stdout().lock())
}

/// Runs the command and prints to `out`; the screens of `top` and `scope` belong to the terminal.
///
/// # Errors
/// As [`run`].
pub fn run_to(command: &Command, rig: &RigName, out: &mut dyn Write) -> anyhow::Result<i32> {
    let code = match command {
        Command::List(args) => list::list(args, out),
        Command::Echo(args) => echo::echo(args, rig, out),
        Command::Hz(args) => rates::hz(args, rig, out),
        Command::Delay(args) => rates::delay(args, rig, out),
        Command::Top(args) => top::top(args, rig, out),
        Command::Scope(args) => scope::scope(args, rig, out),
        Command::Plot(args) => plot::plot(args, rig, out),
    }?;
    out.flush()?;
    Ok(code)
}

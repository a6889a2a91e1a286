//! The command line of `farreach probe`.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};

use crate::scope::ScopeArgs;

/// Observes a running rig without disturbing it, or reads a recording in the same way.
#[derive(Clone, Debug, Subcommand)]
pub enum Command {
    /// Lists the topics, or the fields of one with their units
    #[command(after_help = "Examples:\n  farreach probe list sample\n  \
        farreach probe list --file run.mcap")]
    List(ListArgs),
    /// Prints the messages of a topic as they arrive
    #[command(after_help = "Examples:\n  \
        farreach probe echo sample --count 3 --field tick --field master_position[0]\n  \
        farreach probe echo command --every 0.5 --format csv --file run.mcap")]
    Echo(EchoArgs),
    /// Measures the rate and the jitter of topics
    #[command(after_help = "Examples:\n  farreach probe hz sample command --seconds 2\n  \
        farreach probe hz --file run.mcap")]
    Hz(RateArgs),
    /// Measures the latency of topics
    #[command(after_help = "Examples:\n  farreach probe delay sample command --seconds 2\n  \
        farreach probe delay command --file run.mcap")]
    Delay(RateArgs),
    /// Shows all topics, the timing of all loops and the model beside the machine: redrawn on a
    /// terminal, once in a pipe
    #[command(after_help = "Example:\n  farreach probe top --seconds 2")]
    Top(TopArgs),
    /// Shows channels over time as an oscilloscope does, with a trigger and cursors; or waits for
    /// the trigger and writes the window to a file
    #[command(after_help = "Examples:\n  \
        farreach probe scope handle_torque handle_master --when rising --level 0.5\n  \
        farreach probe scope scanner_trigger --when falling --level 2 --seconds 0.05\n  \
        farreach probe scope handle command.volts[0] --mode roll --seconds 20\n  \
        farreach probe scope handle_torque --level 2 --out window.svg --timeout 60\n  \
        farreach probe scope handle_torque --level 2 --file run.mcap --out window.csv\n\n\
        Keys: h shows them all")]
    Scope(Box<ScopeArgs>),
    /// Opens the live plots of the rig's console in a browser; prints their address where there is
    /// no display
    #[command(after_help = "Example:\n  farreach probe plot handle_master handle_torque")]
    Plot(PlotArgs),
}

impl Command {
    /// Whether it joins a running rig, and so must be run by the rig's user.
    pub fn joins_rig(&self) -> bool {
        match self {
            Self::List(_) => false,
            Self::Echo(args) => args.file.is_none(),
            Self::Hz(args) | Self::Delay(args) => args.file.is_none(),
            Self::Scope(args) => args.file.is_none(),
            Self::Top(_) | Self::Plot(_) => true,
        }
    }
}

/// Arguments of `list`.
#[derive(Clone, Debug, Args)]
pub struct ListArgs {
    /// Topic whose fields to list
    pub topic: Option<String>,
    /// Lists those of a recording, with the number of messages
    #[arg(long, value_name = "FILE.mcap")]
    pub file: Option<PathBuf>,
    /// Prints JSON
    #[arg(long)]
    pub json: bool,
}

/// How `echo` prints messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Format {
    /// One message a line, as name=value
    Text,
    /// One JSON object a line; numbers that are not finite as text
    Json,
    /// A table with a header, the elements of arrays in columns of their own
    Csv,
}

/// Arguments of `echo`.
#[derive(Clone, Debug, Args)]
pub struct EchoArgs {
    /// Topic, as listed by `farreach probe list`
    pub topic: String,
    /// Reads a recording instead of a running rig
    #[arg(long, value_name = "FILE.mcap")]
    pub file: Option<PathBuf>,
    /// Ends after N messages
    #[arg(long, value_name = "N")]
    pub count: Option<u64>,
    /// Ends after one message: the same as --count 1
    #[arg(long, conflicts_with = "count")]
    pub once: bool,
    /// Prints at most one message in this time (s), by the time at which they were published. The
    /// others are skipped, and counted at the end; they are not lost
    #[arg(long, value_name = "SECONDS", value_parser = period)]
    pub every: Option<f64>,
    /// How messages are printed
    #[arg(long, value_enum, default_value_t = Format::Text)]
    pub format: Format,
    /// The same as --format json
    #[arg(long, conflicts_with = "format")]
    pub json: bool,
    /// Prints only this field or element, such as `volts[0]` (repeatable)
    #[arg(long = "field", value_name = "FIELD")]
    pub fields: Vec<String>,
}

impl EchoArgs {
    /// How messages are printed.
    pub(crate) fn format(&self) -> Format {
        if self.json { Format::Json } else { self.format }
    }

    /// After how many messages it ends; `None` where it does not by itself.
    pub(crate) fn count(&self) -> Option<u64> {
        if self.once { Some(1) } else { self.count }
    }
}

/// Arguments of `hz` and `delay`.
#[derive(Clone, Debug, Args)]
pub struct RateArgs {
    /// Topics [default: all]
    pub topics: Vec<String>,
    /// Reads a recording instead of a running rig
    #[arg(long, value_name = "FILE.mcap")]
    pub file: Option<PathBuf>,
    /// Duration of the measurement (s) [default: 5; a recording is read whole]
    #[arg(long, value_parser = seconds)]
    pub seconds: Option<f64>,
    /// Prints JSON
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `top`.
#[derive(Clone, Debug, Args)]
pub struct TopArgs {
    /// Time between two updates (s)
    #[arg(long, default_value_t = 1.0, value_parser = seconds)]
    pub seconds: f64,
    /// Ends after N updates; without it, after one in a pipe, by Ctrl-C on a terminal
    #[arg(long, value_name = "N")]
    pub count: Option<u64>,
}

/// Arguments of `plot`.
#[derive(Clone, Debug, Args)]
pub struct PlotArgs {
    /// Signals to show, by the names that the page lists [default: those that it showed last]
    pub channels: Vec<String>,
}

fn seconds(text: &str) -> Result<f64, String> {
    within(text, 0.1, 86_400.0)
}

/// Reads a time between two messages (s), for the command line.
///
/// # Errors
/// If it is none, or out of range.
pub fn period(text: &str) -> Result<f64, String> {
    within(text, 0.001, 86_400.0)
}

fn within(text: &str, least: f64, most: f64) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if (least..=most).contains(&seconds) => Ok(seconds),
        _ => Err(format!("expected a time from {least} to {most} s")),
    }
}

//! The command line of `farreach probe`.

use clap::{Args, Subcommand};

/// Observes a running rig without disturbing it.
#[derive(Clone, Debug, Subcommand)]
pub enum Command {
    /// Lists the topics, or the fields of one with their units
    #[command(after_help = "Example:\n  farreach probe list sample")]
    List {
        /// Topic whose fields to list
        topic: Option<String>,
        /// Prints JSON
        #[arg(long)]
        json: bool,
    },
    /// Prints the messages of a topic as they arrive
    #[command(after_help = "Example:\n  \
        farreach probe echo sample --count 3 --field tick --field master_position[0]")]
    Echo(EchoArgs),
    /// Measures the rate and the jitter of topics
    #[command(after_help = "Example:\n  farreach probe hz sample command --seconds 2")]
    Hz(RateArgs),
    /// Measures the latency of topics
    #[command(after_help = "Example:\n  farreach probe delay sample command --seconds 2")]
    Delay(RateArgs),
    /// Shows all topics, the timing of all loops and the model beside the machine: redrawn on a
    /// terminal, once in a pipe
    #[command(after_help = "Example:\n  farreach probe top --seconds 2")]
    Top(TopArgs),
}

/// Arguments of `echo`.
#[derive(Clone, Debug, Args)]
pub struct EchoArgs {
    /// Topic, as listed by `farreach probe list`
    pub topic: String,
    /// Ends after N messages
    #[arg(long, value_name = "N")]
    pub count: Option<u64>,
    /// Prints one JSON object per line; numbers that are not finite as text
    #[arg(long)]
    pub json: bool,
    /// Prints only this field or element, such as `volts[0]` (repeatable)
    #[arg(long = "field", value_name = "FIELD")]
    pub fields: Vec<String>,
}

/// Arguments of `hz` and `delay`.
#[derive(Clone, Debug, Args)]
pub struct RateArgs {
    /// Topics [default: all]
    pub topics: Vec<String>,
    /// Duration of the measurement (s)
    #[arg(long, default_value_t = 5.0, value_parser = seconds)]
    pub seconds: f64,
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

fn seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if (0.1..=86_400.0).contains(&seconds) => Ok(seconds),
        _ => Err("expected a time from 0.1 to 86400 s".to_owned()),
    }
}

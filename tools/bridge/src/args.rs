//! The command line of `farreach bridge`.

use std::net::{IpAddr, Ipv4Addr};
use std::path::PathBuf;

use clap::{Args, Subcommand};

/// Hands a running rig's topics to other people's programs.
#[derive(Clone, Debug, Subcommand)]
pub enum Command {
    /// Serves the topics to Foxglove and Lichtblick, which show them live: in these, "Open
    /// connection", "Foxglove WebSocket", and the address that is printed
    #[command(after_help = "Examples:\n  farreach bridge foxglove\n  \
        farreach bridge foxglove --topic sample --topic command --every 0.01\n  \
        farreach bridge foxglove --host 192.168.7.2 --port 8766")]
    Foxglove(FoxgloveArgs),
    /// Sends the samples, and the events as markers, by Lab Streaming Layer, for its recorder and
    /// all programs that receive such streams; needs liblsl, which is looked for when it is run
    #[command(after_help = "Examples:\n  farreach bridge lsl\n  \
        farreach bridge lsl --topic sample --topic setpoint\n  \
        farreach bridge lsl --library venv/lib/python3.13/site-packages/pylsl/lib/liblsl.so")]
    Lsl(LslArgs),
}

/// Arguments of `foxglove`.
#[derive(Clone, Debug, Args)]
pub struct FoxgloveArgs {
    /// Address of this computer to listen at; by default programs of this computer alone reach it.
    /// There is no encryption: name another address in a network of your own only
    #[arg(long, value_name = "ADDRESS", default_value_t = IpAddr::V4(Ipv4Addr::LOCALHOST))]
    pub host: IpAddr,
    /// Port to listen at; 0: any that is free
    #[arg(long, default_value_t = 8765)]
    pub port: u16,
    /// Serves only this topic (repeatable) [default: all]
    #[arg(long = "topic", value_name = "TOPIC")]
    pub topics: Vec<String>,
    /// Sends at most one message of each topic with a fixed rate in this time (s), by the time at
    /// which they were published. The others are skipped, and counted at the end
    #[arg(long, value_name = "SECONDS", value_parser = probe::period)]
    pub every: Option<f64>,
    /// Admits a viewer that is a page of this site, such as `https://viewer.example` (repeatable).
    /// Programs, pages of this computer and Foxglove's own site need not be named
    #[arg(long = "origin", value_name = "ORIGIN")]
    pub origins: Vec<String>,
}

/// Arguments of `lsl`.
#[derive(Clone, Debug, Args)]
pub struct LslArgs {
    /// Sends this topic (repeatable) [default: sample]. Events are sent as markers in any case
    #[arg(long = "topic", value_name = "TOPIC")]
    pub topics: Vec<String>,
    /// liblsl, where the system does not find it by itself
    #[arg(long, value_name = "FILE", env = "PYLSL_LIB", hide_env_values = true)]
    pub library: Option<PathBuf>,
}

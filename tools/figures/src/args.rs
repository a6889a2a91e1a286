//! The command line.

use std::path::PathBuf;

/// Redraws the thesis's figures from the models, beside the published values.
///
/// Writes one page (index.html, needs no network), each figure as SVG, and all numbers
/// (figures.json; figure-4.6.csv has the error of each block of the learning). A program built with
/// `--features png` writes each figure as PNG too. Fits one reduction of the line's stiffness to
/// the measured resonance and predicts the other published numbers with it.
#[derive(Clone, Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  farreach figures --out figures\n  farreach figures --json | jq '.[] \
        | select(.published != null)'\n  farreach figures --from friction.mcap --out friction\n\n\
    Exit codes: 0 done, 1 failed, 2 usage"
)]
pub struct Args {
    /// Writes into this folder; an earlier run's is replaced [default: farreach-figures, with
    /// --json none]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Prints all values as JSON
    #[arg(long)]
    pub json: bool,
    /// Draws what a recording shows instead, beside the declared model: frequency response with
    /// its coherence, friction against position and speed, work of motor and hand
    #[arg(long, value_name = "RECORDING")]
    pub from: Option<PathBuf>,
    /// Axis of the recording, from 0
    #[arg(long, value_name = "N", default_value_t = 0, requires = "from")]
    pub axis: usize,
}

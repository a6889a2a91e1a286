//! What can go wrong.

use std::io;
use std::path::PathBuf;

/// Why the figures could not be made.
#[derive(Debug, thiserror::Error)]
pub enum FiguresError {
    /// A parameter is out of the model's range.
    #[error(transparent)]
    Parameter(#[from] plant::ParameterError),
    /// An effect could not be made.
    #[error(transparent)]
    Effect(#[from] plant::effects::EffectError),
    /// A figure or the page could not be drawn.
    #[error(transparent)]
    Report(#[from] report::Error),
    /// A rig file that is built in is not in order.
    #[error(transparent)]
    Rig(#[from] rig::RigError),
    /// The learning could not be simulated.
    #[error(transparent)]
    IlcTask(#[from] lock_step::ilc::IlcError),
    /// A published value that is asked for is not in the table.
    #[error("no published value `{0}`; its id must stand in the table of published values")]
    Published(&'static str),
    /// A result that a figure shows was not computed.
    #[error(
        "no case `{0}` in the learning study; the figure that shows it must name one that is there"
    )]
    Missing(&'static str),
    /// The model has no resonance where one is looked for.
    #[error("{what}: no peak between {low} and {high} Hz; widen the range or change the constants")]
    NoPeak {
        /// Which line.
        what: String,
        /// Start of the range, Hz.
        low: f64,
        /// Its end, Hz.
        high: f64,
    },
    /// The folder holds what this command did not write.
    #[error("{}: holds {found}, which `farreach figures` did not write; nothing was changed: \
        choose another folder with --out", folder.display())]
    NotOurs {
        /// The folder.
        folder: PathBuf,
        /// What is in it.
        found: String,
    },
    /// Not a folder.
    #[error("{}: expected a folder, found a file; choose another folder with --out", .0.display())]
    NotAFolder(PathBuf),
    /// The system refused.
    #[error("{}: cannot {doing}: {source}; choose a folder that you may write to with \
        --out", path.display())]
    Io {
        /// What was to be done.
        doing: &'static str,
        /// With what.
        path: PathBuf,
        /// The system's words.
        source: io::Error,
    },
}

/// What the functions of this crate return.
pub type Result<T> = std::result::Result<T, FiguresError>;

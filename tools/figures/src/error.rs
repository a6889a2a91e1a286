//! Errors.

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
    /// A built-in rig file is invalid.
    #[error(transparent)]
    Rig(#[from] rig::RigError),
    /// The learning could not be simulated.
    #[error(transparent)]
    IlcTask(#[from] lock_step::ilc::IlcError),
    /// No such published value.
    #[error("no published value `{0}`; its id must stand in the table of published values")]
    Published(&'static str),
    /// A figure shows a result that was not computed.
    #[error(
        "no case `{0}` in the learning study; the figure that shows it must name one that is there"
    )]
    Missing(&'static str),
    /// The model has no resonance in the range searched.
    #[error("{what}: no peak between {low} and {high} Hz; widen the range or change the constants")]
    NoPeak {
        /// Which line.
        what: String,
        /// Start of the range, Hz.
        low: f64,
        /// Its end, Hz.
        high: f64,
    },
    /// The folder holds a file that this command did not write.
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
    /// A system call failed.
    #[error("{}: cannot {doing}: {source}; choose a folder that you may write to with \
        --out", path.display())]
    Io {
        /// The operation.
        doing: &'static str,
        /// Its file or folder.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
}

/// What the functions of this crate return.
pub type Result<T> = std::result::Result<T, FiguresError>;

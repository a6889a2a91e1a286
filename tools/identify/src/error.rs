//! Why data or a rig file cannot be used.

/// What cannot be used, as text with file, place, what was expected, what was found and what to do.
#[derive(Debug, thiserror::Error)]
pub enum IdentifyError {
    /// The command line (exit code 2).
    #[error("{0}")]
    Usage(String),
    /// A rig file or a record (exit code 1).
    #[error("{0}")]
    Unusable(String),
}

impl IdentifyError {
    /// A column as a whole cannot be used.
    pub(crate) fn channel(
        file: &str,
        column: &str,
        found: impl std::fmt::Display,
        advice: impl std::fmt::Display,
    ) -> Self {
        Self::Unusable(format!("{file}, column `{column}`: {found}; {advice}"))
    }

    /// There is too little data.
    pub(crate) fn short(
        file: &str,
        found: impl std::fmt::Display,
        expected: impl std::fmt::Display,
    ) -> Self {
        Self::Unusable(format!("{file}: {found}, expected {expected}; record for longer"))
    }
}

/// What the functions of this crate return.
pub type Result<T> = std::result::Result<T, IdentifyError>;

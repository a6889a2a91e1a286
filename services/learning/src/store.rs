//! A learnt reference on disk.
//!
//! The file names the rig on which the reference was learnt, and is refused on any other.

use std::io::{self, Read};
use std::path::{Path, PathBuf};

use files::{Format, FormatError, LARGEST};
use serde::{Deserialize, Serialize};
use thiserror::Error;

const FORMAT: Format = Format { what: "learnt reference", mark: *b"FRLR", version: 2 };

/// A learnt reference, with the rig and movement it applies to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LearntReference {
    /// The rig and movement.
    pub scope: ReferenceScope,
    /// Mean absolute error over the settled cycles of its block (rad or m); 0 if not measured.
    pub error: f64,
    /// The master's position at each control step of one cycle (rad or m).
    pub positions: Vec<f64>,
}

/// The rig and movement to which a reference applies.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ReferenceScope {
    /// Identity of the rig file ([`rig::RigFile::identity`]).
    pub rig: u64,
    /// Name in the rig file.
    pub rig_name: String,
    /// Axis, from 0.
    pub axis: u32,
    /// Rate of control (Hz).
    pub rate_hz: u32,
    /// Period of the movement (s).
    pub period_s: f64,
    /// Amplitude of the sine that the slave is to follow (rad or m).
    pub amplitude: f64,
    /// Its centre (rad or m).
    pub centre: f64,
    /// Whether control adds its feed-forward.
    pub feedforward: bool,
}

/// Why a reference cannot be saved or loaded.
#[derive(Debug, Error)]
pub enum StoreError {
    /// Not a learnt reference of this version, damaged, or impossible to encode.
    #[error("{0}; learn anew, or choose another file")]
    Format(FormatError),
    /// Its positions are too few, not finite, or do not match its period.
    #[error(
        "learnt reference: expected finite positions over one period, found {found}; learn anew"
    )]
    Positions {
        /// What was found.
        found: String,
    },
    /// Learnt on another rig (or on this one before its rig file was changed), for another axis or
    /// movement, or at another rate.
    #[error("learnt {scope}: expected {expected}, found {found}; {advice}")]
    OtherScope {
        /// What differs: `on another rig`, `for another axis`, `at another rate`, `for another
        /// movement`.
        scope: &'static str,
        /// What is at hand.
        expected: String,
        /// What the file says.
        found: String,
        /// What to do.
        advice: &'static str,
    },
    /// A file operation failed.
    #[error("{path}: cannot {doing}: {source}")]
    Io {
        /// The operation.
        doing: &'static str,
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
}

impl ReferenceScope {
    fn rig(&self) -> String {
        format!("\"{}\" with the rig file of identity {:016x}", self.rig_name, self.rig)
    }

    fn movement(&self) -> String {
        let feedforward = if self.feedforward { "with" } else { "without" };
        let Self { amplitude, centre, period_s, .. } = self;
        format!(
            "a sine of {amplitude:.6} rad or m about {centre:.6}, period {period_s} s, \
                {feedforward} feed-forward"
        )
    }
}

impl LearntReference {
    /// Creates a reference of `positions` (rad or m), one for each step of the cycle; `error` is
    /// its block's (rad or m).
    ///
    /// # Errors
    /// [`StoreError::Positions`].
    pub fn new(
        scope: &ReferenceScope,
        error: f64,
        positions: Vec<f64>,
    ) -> Result<Self, StoreError> {
        let reference = Self { scope: scope.clone(), error, positions };
        reference.check()?;
        Ok(reference)
    }

    /// Encodes the reference.
    ///
    /// # Errors
    /// [`StoreError::Positions`], [`StoreError::Format`].
    pub fn encode(&self) -> Result<Vec<u8>, StoreError> {
        self.check()?;
        FORMAT.encode(self).map_err(StoreError::Format)
    }

    /// Decodes a reference of any rig.
    ///
    /// # Errors
    /// [`StoreError::Format`], [`StoreError::Positions`]; a damaged file never yields a reference.
    pub fn decode(bytes: &[u8]) -> Result<Self, StoreError> {
        let reference: Self = FORMAT.decode(bytes).map_err(StoreError::Format)?;
        reference.check()?;
        Ok(reference)
    }

    /// Writes the file whole or not at all.
    ///
    /// # Errors
    /// Those of [`LearntReference::encode`], [`StoreError::Io`]; an older file is then as it was.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), StoreError> {
        let path = path.as_ref();
        files::replace(path, self.encode()?).map_err(|source| StoreError::Io {
            doing: "write",
            path: path.to_owned(),
            source,
        })
    }

    /// Reads a file that was learnt on this rig, for this axis, at this rate and for this movement.
    ///
    /// # Errors
    /// Each [`StoreError`].
    pub fn load(path: impl AsRef<Path>, scope: &ReferenceScope) -> Result<Self, StoreError> {
        let path = path.as_ref();
        let failed = |source| StoreError::Io { doing: "read", path: path.to_owned(), source };
        let file = std::fs::File::open(path).map_err(failed)?;
        let mut bytes = Vec::new();
        // One byte more than may be: a longer file is refused, not read.
        file.take(LARGEST as u64 + 1).read_to_end(&mut bytes).map_err(failed)?;
        if bytes.len() > LARGEST {
            let found = format!("more than {LARGEST} bytes");
            return Err(StoreError::Format(FormatError::Mark { format: FORMAT, found }));
        }
        let reference = Self::decode(&bytes)?;
        reference.fits(scope)?;
        Ok(reference)
    }

    /// Whether it belongs to that machine and movement.
    ///
    /// # Errors
    /// [`StoreError::OtherScope`].
    pub fn fits(&self, scope: &ReferenceScope) -> Result<(), StoreError> {
        let own = &self.scope;
        let near = |a: f64, b: f64| (a - b).abs() < 1e-9;
        let same_movement = near(own.period_s, scope.period_s)
            && near(own.amplitude, scope.amplitude)
            && near(own.centre, scope.centre)
            && own.feedforward == scope.feedforward;
        let (differs, text, advice): (_, fn(&ReferenceScope) -> String, _) = if own.rig != scope.rig
        {
            ("on another rig", ReferenceScope::rig, "learn anew on this rig")
        } else if own.axis != scope.axis {
            ("for another axis", |of| format!("axis {}", of.axis), "choose that axis's file")
        } else if own.rate_hz != scope.rate_hz {
            ("at another rate", |of| format!("{} Hz", of.rate_hz), "learn anew at this rate")
        } else if !same_movement {
            let advice = "learn anew, or use the movement of the file";
            ("for another movement", ReferenceScope::movement, advice)
        } else {
            return Ok(());
        };
        let (expected, found) = (text(scope), text(own));
        Err(StoreError::OtherScope { scope: differs, expected, found, advice })
    }

    fn check(&self) -> Result<(), StoreError> {
        let found = |found| Err(StoreError::Positions { found });
        let ReferenceScope { amplitude, centre, period_s, rate_hz, .. } = self.scope;
        let numbers = [amplitude, centre, self.error, period_s];
        if let Some(value) = self.positions.iter().chain(&numbers).find(|value| !value.is_finite())
        {
            return found(format!("{value}"));
        }
        let steps = period_s * f64::from(rate_hz);
        let matches =
            !self.positions.is_empty() && (steps - self.positions.len() as f64).abs() < 1e-6;
        if matches {
            Ok(())
        } else {
            found(format!("{} positions for {steps} steps", self.positions.len()))
        }
    }
}

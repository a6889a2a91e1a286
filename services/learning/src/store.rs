//! A learnt reference on disk.
//!
//! The bytes: 4 of mark, 2 of version, 8 of checksum (FNV-1a over what follows), then the reference in bincode, little-endian. bincode is
//! unmaintained (RUSTSEC-2025-0141); the version lets another encoding take its place.
//!
//! A reference belongs to the machine that it was learnt on: its file names the rig, and is refused for any other.

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use thiserror::Error;

const MARK: [u8; 4] = *b"FRLR";
const VERSION: u16 = 1;
const HEADER: usize = MARK.len() + 2 + 8;
/// No reference is longer (bytes).
const LONGEST: usize = 16 << 20;

/// A learnt reference, with what it belongs to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LearntReference {
    /// Identity of the rig file ([`rig::RigFile::identity`]).
    pub rig: u64,
    /// Axis, from 0.
    pub axis: u32,
    /// Rate of control that it was learnt at (Hz).
    pub rate_hz: u32,
    /// Period of the movement (s).
    pub period_s: f64,
    /// The master's position at each control step of one cycle (rad or m).
    pub positions: Vec<f64>,
}

/// Why a reference cannot be kept or taken back.
#[derive(Debug, Error)]
pub enum StoreError {
    /// Cut off, or something else altogether.
    #[error(
        "no learnt reference: expected {HEADER} bytes that begin with \"FRLR\", found {found}; choose another file, or learn anew"
    )]
    NotAReference {
        /// What was found.
        found: String,
    },
    /// Written by another version.
    #[error("learnt reference of version {found}, this build reads version {VERSION}; learn anew")]
    Version {
        /// Version in the file.
        found: u16,
    },
    /// Damaged or cut off.
    #[error("learnt reference is damaged: expected checksum {expected:016x}, found {found:016x}; learn anew")]
    Checksum {
        /// Checksum in the file.
        expected: u64,
        /// Checksum of the bytes.
        found: u64,
    },
    /// Sound bytes that do not decode, or a reference that does not encode.
    #[error("learnt reference cannot be coded: {0}; learn anew")]
    Coding(String),
    /// Its numbers are no periodic movement: too few, not finite, or of another length than its period.
    #[error("learnt reference: expected finite positions over one period, found {found}; learn anew")]
    Positions {
        /// What was found.
        found: String,
    },
    /// Learnt on another rig, or on this one before its rig file was changed.
    #[error(
        "learnt on another rig: expected the rig file of identity {expected:016x}, found {found:016x}; learn anew on this rig"
    )]
    OtherRig {
        /// Identity of the rig at hand.
        expected: u64,
        /// Identity in the file.
        found: u64,
    },
    /// Of another axis.
    #[error("learnt for another axis: expected axis {expected}, found {found}; choose that axis's file")]
    OtherAxis {
        /// Axis at hand.
        expected: u32,
        /// Axis in the file.
        found: u32,
    },
    /// Learnt at another rate.
    #[error("learnt at another rate: expected {expected} Hz, found {found} Hz; learn anew at this rate")]
    OtherRate {
        /// Rate of control at hand (Hz).
        expected: u32,
        /// Rate in the file (Hz).
        found: u32,
    },
    /// The system refused.
    #[error("{}: cannot {doing}: {source}", path.display())]
    Io {
        /// What was to be done.
        doing: &'static str,
        /// With what.
        path: PathBuf,
        /// The system's words.
        source: io::Error,
    },
}

impl LearntReference {
    /// A reference of `positions` (rad or m), one for each step of a cycle at `rate_hz` (Hz).
    ///
    /// # Errors
    /// [`StoreError::Positions`].
    pub fn new(rig: u64, axis: u32, rate_hz: u32, positions: Vec<f64>) -> Result<Self, StoreError> {
        let period_s = positions.len() as f64 / f64::from(rate_hz);
        let reference = Self { rig, axis, rate_hz, period_s, positions };
        reference.check()?;
        Ok(reference)
    }

    /// The bytes to keep.
    ///
    /// # Errors
    /// [`StoreError::Positions`], [`StoreError::Coding`].
    pub fn encode(&self) -> Result<Vec<u8>, StoreError> {
        self.check()?;
        let body = bincode::serde::encode_to_vec(self, bincode::config::standard())
            .map_err(|error| StoreError::Coding(error.to_string()))?;
        let checksum = rig::identity_of_bytes(&body);
        Ok([&MARK[..], &VERSION.to_le_bytes(), &checksum.to_le_bytes(), &body].concat())
    }

    /// The reference in kept bytes, whichever rig it belongs to.
    ///
    /// # Errors
    /// Each [`StoreError`] up to [`StoreError::Positions`]; a damaged file never yields a reference.
    pub fn decode(bytes: &[u8]) -> Result<Self, StoreError> {
        let short = || StoreError::NotAReference { found: format!("{} bytes", bytes.len()) };
        let (mark, rest) = bytes.split_first_chunk::<4>().ok_or_else(short)?;
        if *mark != MARK {
            return Err(StoreError::NotAReference { found: format!("\"{}\"", mark.escape_ascii()) });
        }
        let (version, rest) = rest.split_first_chunk::<2>().ok_or_else(short)?;
        let version = u16::from_le_bytes(*version);
        if version != VERSION {
            return Err(StoreError::Version { found: version });
        }
        let (checksum, body) = rest.split_first_chunk::<8>().ok_or_else(short)?;
        let (expected, found) = (u64::from_le_bytes(*checksum), rig::identity_of_bytes(body));
        if expected != found {
            return Err(StoreError::Checksum { expected, found });
        }
        let config = bincode::config::standard().with_limit::<LONGEST>();
        let (reference, read) = bincode::serde::decode_from_slice::<Self, _>(body, config)
            .map_err(|error| StoreError::Coding(error.to_string()))?;
        if read != body.len() {
            return Err(StoreError::Coding(format!("{} bytes too many", body.len() - read)));
        }
        reference.check()?;
        Ok(reference)
    }

    /// Writes the file whole or not at all: beside it first, then in its place.
    ///
    /// # Errors
    /// Those of [`LearntReference::encode`], [`StoreError::Io`]; an older file is then as it was.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), StoreError> {
        let path = path.as_ref();
        let bytes = self.encode()?;
        let failed = |doing| move |source| StoreError::Io { doing, path: path.to_owned(), source };
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let mut file =
            tempfile::Builder::new().prefix(".learnt-").tempfile_in(folder).map_err(failed("write beside"))?;
        file.write_all(&bytes).map_err(failed("write"))?;
        file.as_file().sync_all().map_err(failed("bring to the disk"))?;
        file.persist(path).map_err(|error| failed("replace")(error.error))?;
        Ok(())
    }

    /// Reads a file that was learnt on this rig (its identity), for this axis (from 0), at this rate (Hz).
    ///
    /// # Errors
    /// Each [`StoreError`].
    pub fn load(path: impl AsRef<Path>, rig: u64, axis: u32, rate_hz: u32) -> Result<Self, StoreError> {
        let path = path.as_ref();
        let failed = |source| StoreError::Io { doing: "read", path: path.to_owned(), source };
        let reference = Self::decode(&std::fs::read(path).map_err(failed)?)?;
        if reference.rig != rig {
            return Err(StoreError::OtherRig { expected: rig, found: reference.rig });
        }
        if reference.axis != axis {
            return Err(StoreError::OtherAxis { expected: axis, found: reference.axis });
        }
        if reference.rate_hz != rate_hz {
            return Err(StoreError::OtherRate { expected: rate_hz, found: reference.rate_hz });
        }
        Ok(reference)
    }

    fn check(&self) -> Result<(), StoreError> {
        let found = |found| Err(StoreError::Positions { found });
        if let Some(value) = self.positions.iter().find(|value| !value.is_finite()) {
            return found(format!("{value}"));
        }
        let steps = self.period_s * f64::from(self.rate_hz);
        let matches = !self.positions.is_empty() && (steps - self.positions.len() as f64).abs() < 1e-6;
        if matches { Ok(()) } else { found(format!("{} positions for {steps} steps", self.positions.len())) }
    }
}

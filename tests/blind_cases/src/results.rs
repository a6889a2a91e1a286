//! The results file of a campaign: one line (JSON) per scored case, with everything that its answer
//! may depend on besides seed and case.
//!
//! Lines of different programs, or of one program with different options, are different campaigns:
//! they may share a file, but never a table. Older files lack some of the fields; their lines are
//! campaigns of their own.

use std::collections::{BTreeMap, HashMap};
use std::fmt;
use std::fs::File;
use std::io::{self, BufRead, BufReader};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::case::Set;
use crate::effects::Kinds;
use crate::fingerprint;
use crate::rules::Rules;
use crate::score::Score;

/// Program and options. All but the name of the program may be missing in older files.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(default)]
pub struct Configuration {
    /// Version, as the program reports it.
    pub program: String,
    /// Hash of the program's file.
    pub program_hash: Option<String>,
    /// Hash of the rig file.
    pub rig_hash: Option<String>,
    /// Longest time of one case, s.
    pub limit_s: Option<u64>,
    /// Threads that identify was given.
    pub jobs: Option<usize>,
    /// Kinds of the unlisted effects.
    pub unlisted_kinds: Option<Kinds>,
    /// Rules of the cases; not recorded means the usual ones.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rules: Option<Rules>,
}

impl Configuration {
    /// The configuration of a program and a rig file as they are now.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub fn of(
        (program, version): (&Path, &str),
        rig: &Path,
        limit_s: u64,
        jobs: usize,
        (kinds, rules): (Kinds, Rules),
    ) -> Result<Self, ResultsError> {
        let hash = |path: &Path| {
            fingerprint::of_file(path)
                .map(Some)
                .map_err(|source| ResultsError::Read { path: path.to_owned(), source })
        };
        Ok(Self {
            program: version.to_owned(),
            program_hash: hash(program)?,
            rig_hash: hash(rig)?,
            limit_s: Some(limit_s),
            jobs: Some(jobs),
            unlisted_kinds: Some(kinds),
            rules: Some(rules).filter(|rules| *rules != Rules::Usual),
        })
    }

    /// The parts in which another configuration differs.
    pub fn differs(&self, other: &Self) -> Vec<&'static str> {
        let parts = [
            ("version", self.program != other.program),
            ("program file", self.program_hash != other.program_hash),
            ("rig file", self.rig_hash != other.rig_hash),
            ("--limit-s", self.limit_s != other.limit_s),
            ("--jobs", self.jobs != other.jobs),
            ("--unlisted-kinds", self.unlisted_kinds != other.unlisted_kinds),
            ("--rules", self.rules != other.rules),
        ];
        parts.into_iter().filter_map(|(name, differs)| differs.then_some(name)).collect()
    }
}

impl fmt::Display for Configuration {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let short = |hash: &Option<String>| {
            hash.as_ref()
                .map_or_else(|| "not recorded".to_owned(), |hash| hash.chars().take(12).collect())
        };
        let number = |value: Option<String>| value.unwrap_or_else(|| "not recorded".to_owned());
        let name = if self.program.is_empty() {
            "a program that does not say its version"
        } else {
            &self.program
        };
        write!(
            f,
            "{name}; file {}, rig {}, limit-s {}, jobs {}, unlisted-kinds {}",
            short(&self.program_hash),
            short(&self.rig_hash),
            number(self.limit_s.map(|limit| limit.to_string())),
            number(self.jobs.map(|jobs| jobs.to_string())),
            number(self.unlisted_kinds.map(|kinds| kinds.name().to_owned()))
        )?;
        self.rules.map_or(Ok(()), |rules| write!(f, ", rules {}", rules.name()))
    }
}

/// A line of the results file.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Line {
    /// Seed of the campaign.
    pub seed: u64,
    /// Program and options.
    #[serde(flatten)]
    pub configuration: Configuration,
    /// The score.
    #[serde(flatten)]
    pub score: Score,
}

/// Errors of a results file.
#[derive(Debug, thiserror::Error)]
pub enum ResultsError {
    /// A file could not be read.
    #[error("{path}: {source}")]
    Read {
        /// Which.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// A case occurs twice.
    #[error(
        "{path}, line {line}: case {} of seed {seed} again, by the same program asked the same \
         way; it is on line {first} already. Remove one of the two: a case counts once",
        name(*set, *index)
    )]
    Duplicate {
        /// Which file.
        path: PathBuf,
        /// Number of the second line.
        line: usize,
        /// Number of the first.
        first: usize,
        /// Seed.
        seed: u64,
        /// Set of the case.
        set: Set,
        /// Its index.
        index: usize,
    },
}

/// Name of a case, as of its folder.
pub fn name(set: Set, index: usize) -> String {
    format!("{}-{:03}", set.name(), index + 1)
}

/// The scores of one seed.
#[derive(Debug, Default)]
pub struct Results {
    /// By configuration.
    pub campaigns: BTreeMap<Configuration, Vec<Score>>,
    /// Unreadable lines, such as the last one of a campaign that was interrupted.
    pub left_out: Vec<String>,
}

/// Reads the lines of a seed; none if there is no file.
///
/// # Errors
/// [`ResultsError::Duplicate`] if a case occurs twice with one configuration,
/// [`ResultsError::Read`].
pub fn read(path: &Path, seed: u64) -> Result<Results, ResultsError> {
    let unread = |source| ResultsError::Read { path: path.to_owned(), source };
    let mut results = Results::default();
    let file = match File::open(path) {
        Ok(file) => file,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(results),
        Err(error) => return Err(unread(error)),
    };
    let mut seen: HashMap<(String, Set, usize), usize> = HashMap::new();
    for (index, text) in BufReader::new(file).lines().enumerate() {
        let (text, number) = (text.map_err(unread)?, index + 1);
        if text.trim().is_empty() {
            continue;
        }
        match serde_json::from_str::<Line>(&text) {
            Ok(Line { seed: own, configuration, score }) if own == seed => {
                let (set, index) = (score.set, score.index);
                let key = (format!("{configuration:?}"), set, index);
                if let Some(first) = seen.insert(key, number) {
                    return Err(ResultsError::Duplicate {
                        path: path.to_owned(),
                        line: number,
                        first,
                        seed,
                        set,
                        index,
                    });
                }
                results.campaigns.entry(configuration).or_default().push(score);
            }
            Ok(_) => {}
            Err(error) => results
                .left_out
                .push(format!("{}, line {number}: {error}; left out", path.display())),
        }
    }
    Ok(results)
}

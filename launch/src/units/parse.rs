//! The parser: lines to keys, keys to a [`Unit`]. No key is skipped.

use std::path::{Path, PathBuf};
use std::time::Duration;

use super::{Limit, Restart, SchedulingPolicy, StopSignal, Unit, value};

/// Sections and keys that are read, with what they accept. Anything else is an error.
pub const SUPPORTED: &[(&str, &[&str])] = &[
    (
        "Unit",
        &["Description", "Wants", "After", "PartOf", "StartLimitIntervalSec", "StartLimitBurst"],
    ),
    (
        "Service",
        &[
            "Type",
            "NotifyAccess",
            "ExecStart",
            "Environment",
            "EnvironmentFile",
            "RuntimeDirectory",
            "RuntimeDirectoryMode",
            "RuntimeDirectoryPreserve",
            "Restart",
            "RestartSec",
            "RestartPreventExitStatus",
            "TimeoutStartSec",
            "TimeoutStopSec",
            "WatchdogSec",
            "WatchdogSignal",
            "KillMode",
            "KillSignal",
            "CPUSchedulingPolicy",
            "CPUSchedulingPriority",
            "CPUAffinity",
            "LimitMEMLOCK",
            "LimitRTPRIO",
            "OOMScoreAdjust",
        ],
    ),
    ("Install", &["WantedBy"]),
];

/// Keys that may stand more than once; their values add up.
const LISTS: &[&str] = &["Wants", "After", "PartOf", "Environment", "WantedBy"];

/// What is wrong with a unit file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum UnitError {
    /// Not a section header, a comment or `Key=value`; or a key outside a section.
    #[error("{}:{line}: found `{found}`, expected {expected}", file.display())]
    Syntax {
        /// The unit file.
        file: PathBuf,
        /// Line, from 1.
        line: usize,
        /// What stands there.
        found: String,
        /// What may stand there.
        expected: &'static str,
    },
    /// A section that is not honoured.
    #[error(
        "{}:{line}: section [{section}] is not supported here; supported: {supported}",
        file.display()
    )]
    Section {
        /// The unit file.
        file: PathBuf,
        /// Line, from 1.
        line: usize,
        /// The section found.
        section: String,
        /// Those that are.
        supported: String,
    },
    /// A key that is not honoured in this section.
    #[error(
        "{}:{line}: key `{key}` in [{section}] is not supported; supported: {supported}",
        file.display()
    )]
    Key {
        /// The unit file.
        file: PathBuf,
        /// Line, from 1.
        line: usize,
        /// The section.
        section: String,
        /// The key found.
        key: String,
        /// Those that are honoured.
        supported: String,
    },
    /// A key that may stand once stands twice.
    #[error(
        "{}:{line}: key `{key}` is already set in line {first}; expected it once",
        file.display()
    )]
    Repeated {
        /// The unit file.
        file: PathBuf,
        /// Line of the second, from 1.
        line: usize,
        /// The key.
        key: String,
        /// Line of the first.
        first: usize,
    },
    /// A value that is not honoured.
    #[error("{}:{line}: `{key}={found}`: expected {expected}", file.display())]
    Value {
        /// The unit file.
        file: PathBuf,
        /// Line, from 1.
        line: usize,
        /// The key.
        key: String,
        /// The value found.
        found: String,
        /// What is accepted.
        expected: &'static str,
    },
    /// A key that must be there is not.
    #[error("{}: `{key}=` is missing in [{section}]", file.display())]
    Missing {
        /// The unit file.
        file: PathBuf,
        /// The section.
        section: &'static str,
        /// The key.
        key: &'static str,
    },
    /// No unit file for a name that is wanted.
    #[error("no unit file {file} for `{name}`; there are: {known}")]
    Unknown {
        /// Short name.
        name: String,
        /// File that was looked for.
        file: String,
        /// Short names that exist.
        known: String,
    },
    /// Units that are after one another in a ring.
    #[error("After= runs in a ring through {0}")]
    Ring(String),
    /// The directory or the file cannot be read.
    #[error("cannot read {}: {message}", path.display())]
    Read {
        /// What was to be read.
        path: PathBuf,
        /// The system's words.
        message: String,
    },
}

/// One assignment with its line.
struct Assignment {
    section: &'static str,
    key: &'static str,
    value: String,
    line: usize,
}

/// The assignments of one file.
struct File<'a> {
    path: &'a Path,
    assignments: Vec<Assignment>,
}

impl<'a> File<'a> {
    fn read(
        path: &'a Path,
        text: &str,
        instance: &str,
        sections: &[&str],
    ) -> Result<Self, UnitError> {
        let file = || path.to_path_buf();
        let mut assignments: Vec<Assignment> = Vec::new();
        let mut section: Option<(&'static str, &'static [&'static str])> = None;
        for (index, raw) in text.lines().enumerate() {
            let line = index + 1;
            let trimmed = raw.trim();
            if trimmed.is_empty() || trimmed.starts_with(['#', ';']) {
                continue;
            }
            let syntax = |expected| UnitError::Syntax {
                file: file(),
                line,
                found: trimmed.to_owned(),
                expected,
            };
            if trimmed.ends_with('\\') {
                return Err(syntax("the whole value on one line"));
            }
            if let Some(rest) = trimmed.strip_prefix('[') {
                let name = rest.strip_suffix(']').ok_or_else(|| syntax("[Section]"))?;
                let known =
                    SUPPORTED.iter().find(|(known, _)| *known == name && sections.contains(known));
                section = Some(known.copied().ok_or_else(|| UnitError::Section {
                    file: file(),
                    line,
                    section: name.to_owned(),
                    supported: sections.join(", "),
                })?);
                continue;
            }
            let (key, raw_value) = trimmed
                .split_once('=')
                .ok_or_else(|| syntax("Key=value, [Section] or # comment"))?;
            let (key, raw_value) = (key.trim(), raw_value.trim());
            let (section, keys) =
                section.ok_or_else(|| syntax("a [Section] before the first key"))?;
            let key = *keys.iter().find(|known| **known == key).ok_or_else(|| UnitError::Key {
                file: file(),
                line,
                section: section.to_owned(),
                key: key.to_owned(),
                supported: keys.join(", "),
            })?;
            if let Some(first) =
                assignments.iter().find(|earlier| earlier.section == section && earlier.key == key)
                && !LISTS.contains(&key)
            {
                return Err(UnitError::Repeated {
                    file: file(),
                    line,
                    key: key.to_owned(),
                    first: first.line,
                });
            }
            let wrong = |expected| UnitError::Value {
                file: file(),
                line,
                key: key.to_owned(),
                found: raw_value.to_owned(),
                expected,
            };
            if raw_value.is_empty() {
                return Err(wrong("a value; to reset a key by an empty one is not supported"));
            }
            let value = value::specifiers(raw_value, instance).map_err(wrong)?;
            assignments.push(Assignment { section, key, value, line });
        }
        Ok(Self { path, assignments })
    }

    /// Reads the key with `parse`, or gives `default` where it is not set.
    fn optional<T>(
        &self,
        key: &'static str,
        default: T,
        parse: impl FnOnce(&str) -> Result<T, &'static str>,
    ) -> Result<T, UnitError> {
        match self.assignments.iter().find(|assignment| assignment.key == key) {
            None => Ok(default),
            Some(assignment) => {
                parse(&assignment.value).map_err(|expected| self.wrong(assignment, expected))
            }
        }
    }

    fn required<T>(
        &self,
        section: &'static str,
        key: &'static str,
        parse: impl FnOnce(&str) -> Result<T, &'static str>,
    ) -> Result<T, UnitError> {
        self.optional(key, None, |text| parse(text).map(Some))?.ok_or_else(|| UnitError::Missing {
            file: self.path.to_path_buf(),
            section,
            key,
        })
    }

    fn list<T>(
        &self,
        key: &'static str,
        mut parse: impl FnMut(&str) -> Result<T, &'static str>,
    ) -> Result<Vec<T>, UnitError> {
        let mut out = Vec::new();
        for assignment in self.assignments.iter().filter(|assignment| assignment.key == key) {
            let words = value::words(&assignment.value)
                .map_err(|expected| self.wrong(assignment, expected))?;
            for word in words {
                out.push(parse(&word).map_err(|expected| self.wrong(assignment, expected))?);
            }
        }
        Ok(out)
    }

    fn wrong(&self, assignment: &Assignment, expected: &'static str) -> UnitError {
        UnitError::Value {
            file: self.path.to_path_buf(),
            line: assignment.line,
            key: assignment.key.to_owned(),
            found: assignment.value.clone(),
            expected,
        }
    }
}

/// Accepts one value only: that which the launcher does anyway.
fn only(accepted: &'static str) -> impl Fn(&str) -> Result<(), &'static str> {
    move |found| if found == accepted { Ok(()) } else { Err(accepted) }
}

/// `farreach-NAME@INSTANCE.service` to `NAME`.
fn sibling(instance: &str) -> impl Fn(&str) -> Result<String, &'static str> {
    let suffix = format!("@{instance}.service");
    move |found| {
        found
            .strip_prefix("farreach-")
            .and_then(|rest| rest.strip_suffix(suffix.as_str()))
            .filter(|name| !name.is_empty())
            .map(str::to_owned)
            .ok_or("units of the same rig, as farreach-NAME@%i.service")
    }
}

fn limit(text: &str) -> Result<Option<Limit>, &'static str> {
    match text {
        "infinity" => Ok(Some(Limit::Infinity)),
        number => number
            .parse()
            .map(|value| Some(Limit::Value(value)))
            .map_err(|_| "infinity or a whole number"),
    }
}

fn pair(word: &str) -> Result<(String, String), &'static str> {
    word.split_once('=')
        .filter(|(name, _)| !name.is_empty())
        .map(|(name, value)| (name.to_owned(), value.to_owned()))
        .ok_or("NAME=value")
}

/// The scheduling class of the loop; the real-time classes need a priority.
fn scheduling(file: &File, path: &Path) -> Result<SchedulingPolicy, UnitError> {
    const PRIORITY: &str = "a priority from 1 to 99";
    let priority = file.optional("CPUSchedulingPriority", None, |text| {
        value::whole(text, 1, 99, PRIORITY).map(Some)
    })?;
    let scheduling = file.optional("CPUSchedulingPolicy", SchedulingPolicy::Other, |text| {
        let priority = i32::try_from(priority.unwrap_or(1)).unwrap_or(1);
        match text {
            "other" => Ok(SchedulingPolicy::Other),
            "fifo" => Ok(SchedulingPolicy::Fifo(priority)),
            "rr" => Ok(SchedulingPolicy::Rr(priority)),
            _ => Err("other, fifo or rr"),
        }
    })?;
    if scheduling.is_realtime() && priority.is_none() {
        return Err(UnitError::Missing {
            file: path.to_path_buf(),
            section: "Service",
            key: "CPUSchedulingPriority",
        });
    }
    Ok(scheduling)
}

/// Parses the service unit `farreach-NAME@.service` for the rig `instance`.
///
/// # Errors
/// Everything that is not in [`SUPPORTED`], with file, line, key and what is accepted.
pub fn parse_service(
    path: &Path,
    name: &str,
    text: &str,
    instance: &str,
) -> Result<Unit, UnitError> {
    let file = File::read(path, text, instance, &["Unit", "Service", "Install"])?;
    file.list("PartOf", |word| only_target(word, instance))?;
    file.list("WantedBy", |word| only_target(word, instance))?;
    file.required("Service", "Type", only("notify"))?;
    file.optional("NotifyAccess", (), only("main"))?;
    file.optional("KillMode", (), only("mixed"))?;
    file.optional("WatchdogSignal", (), only("SIGKILL"))?;
    file.optional("RuntimeDirectoryMode", (), only("0700"))?;
    file.optional("RuntimeDirectoryPreserve", (), only("yes"))?;
    file.optional("EnvironmentFile", (), |text| {
        if text.starts_with('/') { Ok(()) } else { Err("an absolute path") }
    })?;
    let scheduling = scheduling(&file, path)?;
    Ok(Unit {
        name: name.to_owned(),
        description: file.optional("Description", String::new(), |text| Ok(text.to_owned()))?,
        wants: file.list("Wants", sibling(instance))?,
        after: file.list("After", sibling(instance))?,
        start_limit_interval: file.optional(
            "StartLimitIntervalSec",
            Duration::from_secs(10),
            value::span,
        )?,
        start_limit_burst: file.optional("StartLimitBurst", 5, |text| {
            value::whole(text, 0, 1000, "a number from 0 to 1000").map(|number| number as u32)
        })?,
        exec_start: file.required("Service", "ExecStart", |text| {
            let words = value::words(text)?;
            if words.first().is_some_and(|word| word.starts_with('/')) {
                Ok(words)
            } else {
                Err("the absolute path of the executable, then plain words")
            }
        })?,
        environment: file.list("Environment", pair)?,
        runtime_directory: file.optional("RuntimeDirectory", None, |text| {
            if text.contains(' ') || text.starts_with('/') || text.contains("..") {
                Err("one directory below /run")
            } else {
                Ok(Some(text.to_owned()))
            }
        })?,
        restart: file.optional("Restart", Restart::No, |text| match text {
            "no" => Ok(Restart::No),
            "on-failure" => Ok(Restart::OnFailure),
            "always" => Ok(Restart::Always),
            _ => Err("no, on-failure or always"),
        })?,
        restart_delay: file.optional("RestartSec", Duration::from_millis(100), value::span)?,
        restart_prevent_exit_status: file.list("RestartPreventExitStatus", |word| {
            value::whole(word, 0, 255, "exit codes from 0 to 255").map(|code| code as i32)
        })?,
        timeout_start: file.required("Service", "TimeoutStartSec", value::span)?,
        timeout_stop: file.required("Service", "TimeoutStopSec", value::span)?,
        watchdog: file.optional("WatchdogSec", None, |text| {
            value::span(text).map(|span| Some(span).filter(|span| !span.is_zero()))
        })?,
        kill_signal: file.optional("KillSignal", StopSignal::Terminate, |text| match text {
            "SIGTERM" => Ok(StopSignal::Terminate),
            "SIGINT" => Ok(StopSignal::Interrupt),
            _ => Err("SIGTERM or SIGINT"),
        })?,
        scheduling,
        cpu_affinity: file.optional("CPUAffinity", Vec::new(), value::cores)?,
        limit_memlock: file.optional("LimitMEMLOCK", None, limit)?,
        limit_rtprio: file.optional("LimitRTPRIO", None, limit)?,
        oom_score_adjust: file.optional("OOMScoreAdjust", None, |text| {
            value::whole(text, -1000, 1000, "a number from -1000 to 1000")
                .map(|number| Some(number as i32))
        })?,
    })
}

fn only_target(word: &str, instance: &str) -> Result<(), &'static str> {
    if word == format!("farreach@{instance}.target") { Ok(()) } else { Err("farreach@%i.target") }
}

/// Parses `farreach@.target` for the rig `instance`: the short names that it wants.
///
/// # Errors
/// As [`parse_service`].
pub fn parse_target(path: &Path, text: &str, instance: &str) -> Result<Vec<String>, UnitError> {
    let file = File::read(path, text, instance, &["Unit", "Install"])?;
    const HONOURED: &[&str] = &["Description", "Wants", "WantedBy"];
    if let Some(other) =
        file.assignments.iter().find(|assignment| !HONOURED.contains(&assignment.key))
    {
        return Err(UnitError::Key {
            file: path.to_path_buf(),
            line: other.line,
            section: other.section.to_owned(),
            key: other.key.to_owned(),
            supported: HONOURED.join(", "),
        });
    }
    file.list("Wants", sibling(instance))
}

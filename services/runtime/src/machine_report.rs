//! What `farreach doctor` found on this machine, as it is kept: the logger puts it into every
//! recording, and the watchdog asks for it before a real card is armed.

use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize};

use crate::domain::RigName;

/// Layout of the report; rises whenever a key changes its meaning.
pub const LAYOUT: u32 = 1;
/// A report that is older says nothing of the machine any more (ms): a day.
pub const VALID_MS: u64 = 24 * 60 * 60 * 1000;
/// A clock that was set back by less than this makes no report invalid (ms).
const CLOCK_STEP_MS: u64 = 60_000;

/// What a check says.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// As it should be.
    Pass,
    /// Works; somebody should look.
    Warn,
    /// Must be mended before a motor is powered.
    Fail,
    /// Not examined: the value says why, the remedy what to do.
    Skipped,
}

impl Verdict {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Pass, Self::Warn, Self::Fail, Self::Skipped];

    /// In a word.
    pub const fn text(self) -> &'static str {
        match self {
            Self::Pass => "pass",
            Self::Warn => "warn",
            Self::Fail => "fail",
            Self::Skipped => "skipped",
        }
    }
}

/// What one check found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CheckResult {
    /// Id of the check, a row of docs/doctor.md.
    pub id: String,
    /// What was examined, in words.
    pub title: String,
    /// The verdict.
    pub verdict: Verdict,
    /// What was measured, in words with units.
    pub value: String,
    /// What to do; empty where the check passed.
    pub remedy: String,
    /// What was measured, for programs; its keys depend on the check and end with their unit.
    pub measured: serde_json::Value,
}

/// The rig that was up while the doctor looked.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ExaminedRig {
    /// Name in its rig file.
    pub name: String,
    /// Identity of the rig file's text, 16 hexadecimal digits.
    pub identity: String,
    /// Its card.
    pub card: String,
    /// Its timing profile.
    pub profile: String,
}

/// A report.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MachineReport {
    /// [`LAYOUT`].
    pub layout: u32,
    /// When it was taken (ms since 1970, UTC).
    pub taken_unix_ms: u64,
    /// Name of the machine.
    pub host: String,
    /// Boot of the machine in which it was taken.
    pub boot_id: String,
    /// User who took it (number).
    pub user: u32,
    /// Version of farreach.
    pub version: String,
    /// Git revision of the build.
    pub revision: String,
    /// Name of the rig (`--rig-name`).
    pub rig_name: String,
    /// The rig, if one of that name was up.
    pub rig: Option<ExaminedRig>,
    /// The checks, in their order.
    pub checks: Vec<CheckResult>,
}

/// Why a kept report cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// The file cannot be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// The file is no report of this build's layout.
    #[error("{}: expected a doctor's report of layout {LAYOUT}: {reason}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
}

impl MachineReport {
    /// The file that holds the newest report for a rig's name.
    pub fn file(folder: &Path, rig_name: &RigName) -> PathBuf {
        folder.join(format!("{rig_name}.json"))
    }

    /// Keeps it in `folder`, in place of the one before, whole or not at all.
    ///
    /// # Errors
    /// [`ReportError::Io`].
    pub fn keep(&self, folder: &Path, rig_name: &RigName) -> Result<PathBuf, ReportError> {
        let path = Self::file(folder, rig_name);
        std::fs::create_dir_all(folder)
            .and_then(|()| serde_json::to_vec_pretty(self).map_err(io::Error::from))
            .and_then(|text| files::replace(&path, text))
            .map_err(|source| ReportError::Io { path: path.clone(), source })?;
        Ok(path)
    }

    /// The newest report for a rig's name; `None` where there is none.
    ///
    /// # Errors
    /// [`ReportError`].
    pub fn newest(folder: &Path, rig_name: &RigName) -> Result<Option<Self>, ReportError> {
        let path = Self::file(folder, rig_name);
        let text = match std::fs::read(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(source) => return Err(ReportError::Io { path, source }),
        };
        Self::parse(&text, &path).map(Some)
    }

    /// The report in the text of a file; `path` is for messages.
    ///
    /// # Errors
    /// [`ReportError::Unreadable`].
    pub fn parse(text: &[u8], path: &Path) -> Result<Self, ReportError> {
        let unreadable = |reason: String| ReportError::Unreadable { path: path.to_owned(), reason };
        let report: Self =
            serde_json::from_slice(text).map_err(|error| unreadable(error.to_string()))?;
        match report.layout {
            LAYOUT => Ok(report),
            other => Err(unreadable(format!("found layout {other}"))),
        }
    }

    /// How many checks have this verdict.
    pub fn count(&self, verdict: Verdict) -> usize {
        self.checks.iter().filter(|check| check.verdict == verdict).count()
    }

    /// Ids of the checks with this verdict.
    pub fn ids(&self, verdict: Verdict) -> Vec<&str> {
        let of = self.checks.iter().filter(|check| check.verdict == verdict);
        of.map(|check| check.id.as_str()).collect()
    }

    /// In one line: `2 h 5 min old, 12 pass, 1 warn (isolation), 0 fail, 6 skipped`.
    pub fn summary(&self, now_unix_ms: u64) -> String {
        let counts = Verdict::ALL.map(|verdict| {
            let ids = match verdict {
                Verdict::Warn | Verdict::Fail => self.ids(verdict),
                Verdict::Pass | Verdict::Skipped => Vec::new(),
            };
            let named =
                if ids.is_empty() { String::new() } else { format!(" ({})", ids.join(", ")) };
            format!("{} {}{named}", self.count(verdict), verdict.text())
        });
        format!(
            "{} old, {}",
            age(now_unix_ms.saturating_sub(self.taken_unix_ms)),
            counts.join(", ")
        )
    }
}

/// Why a real card is not to be armed by the newest report; `None` where nothing speaks against it.
/// `boot_id` is that of the present boot: what was found before it says nothing of the kernel that
/// runs now.
pub fn objection(
    report: Option<&MachineReport>,
    boot_id: &str,
    now_unix_ms: u64,
) -> Option<String> {
    let Some(report) = report else { return Some("there is no doctor's report".to_owned()) };
    let age_ms = now_unix_ms.saturating_sub(report.taken_unix_ms);
    if report.taken_unix_ms > now_unix_ms.saturating_add(CLOCK_STEP_MS) {
        return Some("the doctor's report is of the future: the clock was set back".to_owned());
    }
    if age_ms > VALID_MS {
        return Some(format!("the doctor's report is {} old, more than a day", age(age_ms)));
    }
    if report.boot_id != boot_id {
        return Some("the doctor's report is of an earlier boot of this computer".to_owned());
    }
    let failed = report.ids(Verdict::Fail);
    if failed.is_empty() {
        return None;
    }
    Some(format!("the doctor's report has failures: {}", failed.join(", ")))
}

/// A duration in its two largest units.
fn age(ms: u64) -> String {
    let minutes = ms / 60_000;
    match minutes {
        0..60 => format!("{minutes} min"),
        60..1440 => format!("{} h {} min", minutes / 60, minutes % 60),
        _ => format!("{} d {} h", minutes / 1440, minutes % 1440 / 60),
    }
}

/// Identity of this boot of the computer; empty if it cannot be read.
pub fn boot_id() -> String {
    let text = std::fs::read_to_string("/proc/sys/kernel/random/boot_id").unwrap_or_default();
    text.trim().to_owned()
}

/// Wall clock (ms since 1970, UTC).
pub fn unix_ms() -> u64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or(Duration::ZERO);
    u64::try_from(since.as_millis()).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOW: u64 = 1_800_000_000_000;

    fn report(verdicts: &[(&str, Verdict)]) -> MachineReport {
        let check = |(id, verdict): &(&str, Verdict)| CheckResult {
            id: (*id).to_owned(),
            title: format!("the {id}"),
            verdict: *verdict,
            value: "1 µs".to_owned(),
            remedy: String::new(),
            measured: serde_json::json!({ "late_us": 1.5 }),
        };
        MachineReport {
            layout: LAYOUT,
            taken_unix_ms: NOW,
            host: "bench".to_owned(),
            boot_id: "b".to_owned(),
            user: 0,
            version: "0.1.0".to_owned(),
            revision: "unknown".to_owned(),
            rig_name: "bench".to_owned(),
            rig: None,
            checks: verdicts.iter().map(check).collect(),
        }
    }

    #[test]
    fn a_report_is_valid_for_a_day_of_one_boot_and_without_failures() {
        let sound = report(&[("clock", Verdict::Pass), ("isolation", Verdict::Warn)]);
        let told = |report, boot, now| objection(report, boot, now).unwrap_or_default();
        assert_eq!(told(Some(&sound), "b", NOW), "");
        assert_eq!(told(Some(&sound), "b", NOW + VALID_MS), "");
        let old = told(Some(&sound), "b", NOW + VALID_MS + 1);
        assert_eq!(old, "the doctor's report is 1 d 0 h old, more than a day");
        assert!(told(Some(&sound), "c", NOW).contains("earlier boot"));
        assert_eq!(told(Some(&sound), "b", NOW - CLOCK_STEP_MS), "");
        assert!(told(Some(&sound), "b", NOW - CLOCK_STEP_MS - 1).contains("future"));
        assert_eq!(told(None, "b", NOW), "there is no doctor's report");
        let ill = report(&[("clock", Verdict::Fail), ("stalls", Verdict::Fail)]);
        let failed = told(Some(&ill), "b", NOW);
        assert_eq!(failed, "the doctor's report has failures: clock, stalls");
    }

    #[test]
    fn it_is_kept_whole_and_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path().join("made/by/it");
        let name: RigName = "bench".parse().unwrap();
        assert!(MachineReport::newest(&folder, &name).unwrap().is_none());
        let kept = report(&[("clock", Verdict::Skipped)]);
        let path = kept.keep(&folder, &name).unwrap();
        assert_eq!(MachineReport::newest(&folder, &name).unwrap(), Some(kept.clone()));
        for (text, part) in [("{", "layout 1"), ("", "layout 1")] {
            std::fs::write(&path, text).unwrap();
            let error = MachineReport::newest(&folder, &name).unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        }
        let later = MachineReport { layout: LAYOUT + 1, ..kept };
        later.keep(&folder, &name).unwrap();
        let error = MachineReport::newest(&folder, &name).unwrap_err().to_string();
        assert!(error.ends_with("found layout 2"), "{error}");
    }

    #[test]
    fn the_summary_names_what_is_wrong() {
        let mixed = report(&[
            ("clock", Verdict::Pass),
            ("isolation", Verdict::Warn),
            ("stalls", Verdict::Fail),
            ("card", Verdict::Skipped),
        ]);
        assert_eq!(
            mixed.summary(NOW + 125 * 60_000),
            "2 h 5 min old, 1 pass, 1 warn (isolation), 1 fail (stalls), 1 skipped"
        );
        assert!(mixed.summary(NOW).starts_with("0 min old, "));
    }
}

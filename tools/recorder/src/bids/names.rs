//! Names of files in a dataset.

use std::path::PathBuf;
use std::str::FromStr;

use anyhow::bail;

/// What the names of a run's files have in common.
#[derive(Clone, Debug)]
pub(super) struct Names {
    pub(super) subject: String,
    pub(super) session: Option<String>,
    pub(super) task: String,
    /// Empty for a task that was run once.
    pub(super) run: String,
}

impl Names {
    /// `sub-S07_task-forcematching_run-1`.
    pub(super) fn stem(&self) -> String {
        self.with("", "", "")
    }

    /// The folder of a session, or of a subject without sessions, from that of the dataset.
    pub(super) fn folder(&self) -> PathBuf {
        let mut folder = PathBuf::from(format!("sub-{}", self.subject));
        if let Some(session) = &self.session {
            folder.push(format!("ses-{session}"));
        }
        folder
    }

    /// A file of this data type, such as `func` and `events.tsv`, from the dataset's folder.
    pub(super) fn file(&self, datatype: &str, suffix: &str) -> PathBuf {
        self.folder().join(datatype).join(self.with("", "", suffix))
    }

    /// A recording beside others of the run.
    pub(super) fn recording(&self, datatype: &str, recording: &str, suffix: &str) -> PathBuf {
        self.folder().join(datatype).join(self.with("", recording, suffix))
    }

    /// A file of a tracking system.
    pub(super) fn tracking(&self, system: &str, suffix: &str) -> PathBuf {
        self.folder().join("motion").join(self.with(system, "", suffix))
    }

    /// The table of a session's files.
    pub(super) fn scans(&self) -> PathBuf {
        let session = self.session.as_ref().map(|session| format!("_ses-{session}"));
        let name = format!("sub-{}{}_scans.tsv", self.subject, session.unwrap_or_default());
        self.folder().join(name)
    }

    /// The parts of a name stand in the order that BIDS asks for.
    fn with(&self, tracking: &str, recording: &str, suffix: &str) -> String {
        let parts = [
            ("sub", self.subject.as_str()),
            ("ses", self.session.as_deref().unwrap_or_default()),
            ("task", &self.task),
            ("tracksys", tracking),
            ("run", &self.run),
            ("recording", recording),
        ];
        let given = parts.iter().filter(|(_, value)| !value.is_empty());
        let mut name = given.map(|(key, value)| format!("{key}-{value}")).collect::<Vec<_>>();
        if !suffix.is_empty() {
            name.push(suffix.to_owned());
        }
        name.join("_")
    }
}

/// What the runs of a task are called.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FirstRun {
    /// Numbers follow each other from this one on, with at least so many digits.
    Number(u32, usize),
    /// No number: a task was run once.
    Single,
}

impl FromStr for FirstRun {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "none" {
            return Ok(Self::Single);
        }
        let digits = !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
        match text.parse() {
            Ok(number @ 1..=10_000) if digits => Ok(Self::Number(number, text.len())),
            _ => Err("expected a number from 1 to 10000, such as 2 or 02, or `none`".to_owned()),
        }
    }
}

/// The labels of runs: those of a task follow each other.
pub(super) struct RunLabels {
    first: FirstRun,
    given: Vec<String>,
}

impl RunLabels {
    pub(super) fn from(first: Option<&FirstRun>) -> Self {
        Self { first: first.cloned().unwrap_or(FirstRun::Number(1, 1)), given: Vec::new() }
    }

    /// The label of the next run of a task; empty for none.
    pub(super) fn next(&mut self, task: &str) -> String {
        let before = self.given.iter().filter(|given| *given == task).count();
        self.given.push(task.to_owned());
        match self.first {
            FirstRun::Number(first, width) => format!("{:0width$}", first + before as u32),
            FirstRun::Single => String::new(),
        }
    }
}

/// A label as BIDS accepts it: letters and digits. Hyphens, blanks and the like are left out.
///
/// # Errors
/// Where nothing is left, or a letter is not of the English alphabet.
pub(super) fn label(what: &str, text: &str) -> anyhow::Result<String> {
    if let Some(strange) = text.chars().find(|c| c.is_alphanumeric() && !c.is_ascii()) {
        bail!("{what}: expected the letters A to Z and digits, found {strange:?} in \"{text}\"");
    }
    let label: String = text.chars().filter(char::is_ascii_alphanumeric).collect();
    if label.is_empty() {
        bail!("{what}: expected letters and digits, found \"{text}\"");
    }
    Ok(label)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_parts_of_a_name_stand_in_order() -> anyhow::Result<()> {
        let mut names = Names {
            subject: label("subject", "S-07")?,
            session: None,
            task: label("task", "force-matching")?,
            run: "2".to_owned(),
        };
        let shown = |path: PathBuf| path.to_string_lossy().into_owned();
        let expected = "sub-S07/func/sub-S07_task-forcematching_run-2_recording-handle_physio.json";
        assert_eq!(shown(names.recording("func", "handle", "physio.json")), expected);
        names.session = Some("b".to_owned());
        let expected = "sub-S07/ses-b/motion/\
                        sub-S07_ses-b_task-forcematching_tracksys-handle_run-2_motion.tsv";
        assert_eq!(shown(names.tracking("handle", "motion.tsv")), expected);
        assert_eq!(shown(names.scans()), "sub-S07/ses-b/sub-S07_ses-b_scans.tsv");
        assert_eq!(names.stem(), "sub-S07_ses-b_task-forcematching_run-2");
        Ok(())
    }

    #[test]
    fn what_is_no_label_is_refused() {
        for wrong in ["", "-", "Jürgen", "被験者"] {
            assert!(label("subject", wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn runs_of_a_task_are_counted() {
        let labels = |first: &str| -> Result<Vec<String>, String> {
            let mut labels = RunLabels::from(Some(&first.parse()?));
            Ok(["a", "b", "a", "a"].map(|task| labels.next(task)).to_vec())
        };
        assert_eq!(labels("3"), Ok(["3", "3", "4", "5"].map(str::to_owned).to_vec()));
        assert_eq!(labels("09"), Ok(["09", "09", "10", "11"].map(str::to_owned).to_vec()));
        assert_eq!(labels("none"), Ok(vec![String::new(); 4]));
        for wrong in ["", "0", "-1", "+1", "1.0", "one", "10001"] {
            assert!(labels(wrong).is_err(), "{wrong}");
        }
    }
}

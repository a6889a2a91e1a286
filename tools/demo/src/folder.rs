//! The output folder of a run.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};

/// A file that marks a folder of the demo, so that the next run may replace the results in it.
const MARK: &str = ".farreach-demo";
const RECORDING: &str = "run.mcap";
const PAGE: &str = "report.html";
const SUMMARY: &str = "summary.json";
const BEFORE: &str = "before.mcap";
const EXCITATION: &str = "excitation.mcap";
const AFTER: &str = "after.mcap";
const RIG: &str = "rig.toml";
/// All of them.
const RESULTS: [&str; 7] = [RECORDING, PAGE, SUMMARY, BEFORE, EXCITATION, AFTER, RIG];

/// A folder that is ready for a run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Folder(PathBuf);

impl Folder {
    /// Makes the folder, or clears an earlier run out of it: its recording (all parts), its page,
    /// its summary. Other files stay.
    ///
    /// # Errors
    /// Where one of those names is taken by a file that no demo wrote, or the system refuses.
    pub fn prepare(path: &Path) -> anyhow::Result<Self> {
        let wrong = |doing, path: &Path| {
            let path = path.display().to_string();
            move || format!("cannot {doing} {path}")
        };
        let path = std::path::absolute(path).with_context(wrong("make absolute", path))?;
        fs::create_dir_all(&path).with_context(wrong("make", &path))?;
        let mut found = Vec::new();
        for entry in fs::read_dir(&path).with_context(wrong("read", &path))? {
            let name = entry
                .with_context(wrong("read", &path))?
                .file_name()
                .to_string_lossy()
                .into_owned();
            if is_result(&name) {
                found.push(name);
            }
        }
        found.sort();
        let mark = path.join(MARK);
        if let Some(file) = found.first()
            && !mark.exists()
        {
            bail!(
                "{}: has a {file} that no demo wrote; nothing was overwritten: choose another \
                    folder with --out, or move the file away",
                path.display()
            );
        }
        for file in found {
            let file = path.join(file);
            fs::remove_file(&file).with_context(wrong("remove", &file))?;
        }
        fs::write(&mark, "farreach demo replaces its files in this folder\n")
            .with_context(wrong("write", &mark))?;
        Ok(Self(path))
    }

    /// `run.mcap`.
    pub fn recording(&self) -> PathBuf {
        self.0.join(RECORDING)
    }

    /// `report.html`.
    pub fn page(&self) -> PathBuf {
        self.0.join(PAGE)
    }

    /// `summary.json`.
    pub fn summary(&self) -> PathBuf {
        self.0.join(SUMMARY)
    }

    /// `before.mcap`: the movement with the control as it is.
    pub fn before(&self) -> PathBuf {
        self.0.join(BEFORE)
    }

    /// `excitation.mcap`.
    pub fn excitation(&self) -> PathBuf {
        self.0.join(EXCITATION)
    }

    /// `after.mcap`: the movement with the rig file proposed.
    pub fn after(&self) -> PathBuf {
        self.0.join(AFTER)
    }

    /// `rig.toml`, the rig file proposed.
    pub fn rig_file(&self) -> PathBuf {
        self.0.join(RIG)
    }

    /// All of them.
    pub fn files(&self) -> Vec<PathBuf> {
        RESULTS.iter().map(|name| self.0.join(name)).collect()
    }

    /// Whether the logger was restarted and wrote a second part, which the demo never causes.
    pub fn further_parts(&self) -> bool {
        self.0.join("run.part2.mcap").exists()
    }
}

fn is_result(name: &str) -> bool {
    let part = name.strip_prefix("run.part").and_then(|rest| rest.strip_suffix(".mcap"));
    RESULTS.contains(&name) || part.is_some_and(|number| number.parse::<u32>().is_ok())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used)]

    use super::*;

    #[test]
    fn an_earlier_run_is_replaced_and_nothing_else() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a/b");
        let folder = Folder::prepare(&path).unwrap();
        for file in ["run.mcap", "run.part2.mcap", "report.html", "notes.txt", "run.party.mcap"] {
            fs::write(path.join(file), "x").unwrap();
        }
        assert!(folder.further_parts());
        let again = Folder::prepare(&path).unwrap();
        assert!(!again.recording().exists() && !again.page().exists() && !again.further_parts());
        assert!(path.join("notes.txt").exists() && path.join("run.party.mcap").exists());
    }

    #[test]
    fn what_no_demo_wrote_is_not_touched() {
        let directory = tempfile::tempdir().unwrap();
        fs::write(directory.path().join("run.mcap"), "precious").unwrap();
        let error = Folder::prepare(directory.path()).unwrap_err();
        assert!(
            error.to_string().contains("run.mcap") && error.to_string().contains("--out"),
            "{error}"
        );
        assert_eq!(fs::read(directory.path().join("run.mcap")).unwrap(), b"precious");
    }

    #[test]
    fn a_file_where_the_folder_should_be_is_named() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("file");
        fs::write(&path, "").unwrap();
        let error = Folder::prepare(&path).unwrap_err();
        assert!(error.to_string().contains("cannot make"), "{error}");
    }
}

//! The output folder of a run.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// A file that marks a folder of the demo, so that the next run may replace the results in it.
const MARK: &str = ".farreach-demo";
const RECORDING: &str = "run.mcap";
const PAGE: &str = "report.html";
const SUMMARY: &str = "summary.json";

/// The folder cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum FolderError {
    /// A file of that name was not written by a demo.
    #[error(
        "{}: has a {file} that no demo wrote; nothing was overwritten: choose another folder with \
            --out, or move the file away",
        folder.display()
    )]
    NotOurs {
        /// The folder.
        folder: PathBuf,
        /// The file in it.
        file: String,
    },
    /// A system call failed.
    #[error("cannot {doing} {}: {source}", path.display())]
    Io {
        /// The operation.
        doing: &'static str,
        /// Its file or folder.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
}

/// A folder that is ready for a run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Folder(PathBuf);

impl Folder {
    /// Makes the folder, or clears an earlier run out of it: its recording (all parts), its page,
    /// its summary. Other files stay.
    ///
    /// # Errors
    /// [`FolderError::NotOurs`] where one of those names is taken by a file that no demo wrote;
    /// [`FolderError::Io`].
    pub fn prepare(path: &Path) -> Result<Self, FolderError> {
        let wrong = |doing, path: &Path| {
            let path = path.to_owned();
            move |source| FolderError::Io { doing, path, source }
        };
        let path = std::path::absolute(path).map_err(wrong("make absolute", path))?;
        fs::create_dir_all(&path).map_err(wrong("make", &path))?;
        let mut found = Vec::new();
        for entry in fs::read_dir(&path).map_err(wrong("read", &path))? {
            let name =
                entry.map_err(wrong("read", &path))?.file_name().to_string_lossy().into_owned();
            if is_result(&name) {
                found.push(name);
            }
        }
        found.sort();
        let mark = path.join(MARK);
        if let Some(file) = found.first()
            && !mark.exists()
        {
            return Err(FolderError::NotOurs { folder: path, file: file.clone() });
        }
        for file in found {
            let file = path.join(file);
            fs::remove_file(&file).map_err(wrong("remove", &file))?;
        }
        fs::write(&mark, "farreach demo replaces its files in this folder\n")
            .map_err(wrong("write", &mark))?;
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

    /// Whether the logger was restarted and wrote a second part, which the demo never causes.
    pub fn further_parts(&self) -> bool {
        self.0.join("run.part2.mcap").exists()
    }
}

fn is_result(name: &str) -> bool {
    let part = name.strip_prefix("run.part").and_then(|rest| rest.strip_suffix(".mcap"));
    [RECORDING, PAGE, SUMMARY].contains(&name)
        || part.is_some_and(|number| number.parse::<u32>().is_ok())
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
        assert!(matches!(Folder::prepare(&path), Err(FolderError::Io { doing: "make", .. })));
    }
}

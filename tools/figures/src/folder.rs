//! The output folder, written completely or not at all.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};

/// A file that marks a folder of this command, so that the next run may replace it.
const MARK: &str = ".farreach-figures";

/// Error per block of the learning, as a table.
pub(crate) const ERRORS_CSV: &str = "figure-4.6.csv";

/// Checks that a folder can be written before anything is computed.
///
/// # Errors
/// Where it is a file, holds what this command did not write, or cannot be written to.
pub(crate) fn check(folder: &Path) -> Result<PathBuf> {
    let folder = std::path::absolute(folder).with_context(refused("make absolute", folder))?;
    if folder.exists() {
        if !folder.is_dir() {
            bail!(
                "{}: expected a folder, found a file; choose another folder with --out",
                folder.display()
            );
        }
        let ours = folder.join(MARK).exists();
        for entry in fs::read_dir(&folder).with_context(refused("read", &folder))? {
            let name = entry
                .with_context(refused("read", &folder))?
                .file_name()
                .to_string_lossy()
                .into_owned();
            if !(ours && is_result(&name)) {
                bail!(
                    "{}: holds {name}, which `farreach figures` did not write; nothing was \
                        changed: choose another folder with --out",
                    folder.display()
                );
            }
        }
    }
    // Fails now, before the computation, where nothing can be written.
    beside(&folder)?;
    Ok(folder)
}

/// Writes files into a folder that [`check`] passed. They are written beside it and take its place
/// at the end.
///
/// # Errors
/// Where it cannot be written to; the folder is then as it was.
pub(crate) fn write(folder: &Path, files: &[(String, Vec<u8>)]) -> Result<()> {
    let temporary = beside(folder)?;
    let fresh = temporary.path().join("fresh");
    fs::create_dir(&fresh).with_context(refused("make", &fresh))?;
    for (name, content) in files {
        let path = fresh.join(name);
        fs::write(&path, content).with_context(refused("write", &path))?;
    }
    let mark = fresh.join(MARK);
    fs::write(&mark, "farreach figures replaces this folder\n")
        .with_context(refused("write", &mark))?;
    let old = temporary.path().join("old");
    if folder.exists() {
        fs::rename(folder, &old).with_context(refused("replace", folder))?;
    }
    let placed = fs::rename(&fresh, folder).with_context(refused("make", folder));
    placed.inspect_err(|_| {
        // Restores the old folder; if that fails too, the first error says more.
        let _ = fs::rename(&old, folder);
    })
}

fn beside(folder: &Path) -> Result<tempfile::TempDir> {
    let parent = folder.parent().unwrap_or(folder);
    fs::create_dir_all(parent).with_context(refused("make", parent))?;
    tempfile::Builder::new()
        .prefix(".farreach-figures-")
        .tempdir_in(parent)
        .with_context(refused("write into", parent))
}

fn is_result(name: &str) -> bool {
    let figure = name
        .strip_prefix("figure-")
        .and_then(|rest| rest.strip_suffix(".svg").or(rest.strip_suffix(".png")));
    [MARK, "index.html", "figures.json", ERRORS_CSV].contains(&name)
        || figure.is_some_and(|number| number.chars().all(|c| c.is_ascii_digit() || c == '.'))
}

/// What could not be done with which file or folder.
fn refused(doing: &'static str, path: &Path) -> impl FnOnce() -> String + use<> {
    let path = path.display().to_string();
    move || format!("{path}: cannot {doing}; choose a folder that you may write to with --out")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn files(text: &str) -> Vec<(String, Vec<u8>)> {
        vec![("index.html".to_owned(), text.into()), ("figure-3.4.svg".to_owned(), text.into())]
    }

    #[test]
    fn an_earlier_run_is_replaced() {
        let directory = tempfile::tempdir().unwrap();
        let folder = check(&directory.path().join("a/b")).unwrap();
        assert!(!folder.exists(), "nothing is made before there is something to put in");
        write(&folder, &files("one")).unwrap();
        let folder = check(&folder).unwrap();
        write(&folder, &files("two")).unwrap();
        assert_eq!(fs::read_to_string(folder.join("index.html")).unwrap(), "two");
        assert_eq!(
            fs::read_dir(folder.parent().unwrap()).unwrap().count(),
            1,
            "nothing is left beside it"
        );
    }

    #[test]
    fn what_others_wrote_is_not_touched() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("index.html");
        fs::write(&file, "precious").unwrap();
        let error = check(directory.path()).unwrap_err();
        assert!(error.to_string().contains("holds index.html, which"), "{error}");
        let error = check(&file).unwrap_err();
        assert!(error.to_string().contains("expected a folder, found a file"), "{error}");
        let error = check(&file.join("below")).unwrap_err();
        assert!(error.to_string().contains("--out"), "{error}");
        assert_eq!(fs::read(&file).unwrap(), b"precious");
    }

    #[test]
    fn notes_in_our_folder_are_kept() {
        let directory = tempfile::tempdir().unwrap();
        let folder = directory.path().join("figures");
        write(&folder, &files("one")).unwrap();
        fs::write(folder.join("notes.txt"), "mine").unwrap();
        let error = check(&folder).unwrap_err();
        assert!(error.to_string().contains("holds notes.txt, which"), "{error}");
    }
}

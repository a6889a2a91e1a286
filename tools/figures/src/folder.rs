//! The output folder, written completely or not at all.

use std::fs;
use std::path::{Path, PathBuf};

use crate::error::{FiguresError, Result};

/// A file that marks a folder of this command, so that the next run may replace it.
const MARK: &str = ".farreach-figures";

/// Error per block of the learning, as a table.
pub(crate) const ERRORS_CSV: &str = "figure-4.6.csv";

/// Checks that a folder can be written before anything is computed.
///
/// # Errors
/// [`FiguresError::NotAFolder`], [`FiguresError::NotOurs`], [`FiguresError::Io`].
pub(crate) fn check(folder: &Path) -> Result<PathBuf> {
    let folder = std::path::absolute(folder).map_err(io("make absolute", folder))?;
    if folder.exists() {
        if !folder.is_dir() {
            return Err(FiguresError::NotAFolder(folder));
        }
        let ours = folder.join(MARK).exists();
        for entry in fs::read_dir(&folder).map_err(io("read", &folder))? {
            let name =
                entry.map_err(io("read", &folder))?.file_name().to_string_lossy().into_owned();
            if !(ours && is_result(&name)) {
                return Err(FiguresError::NotOurs { folder, found: name });
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
/// [`FiguresError::Io`]; the folder is then as it was.
pub(crate) fn write(folder: &Path, files: &[(String, Vec<u8>)]) -> Result<()> {
    let temporary = beside(folder)?;
    let fresh = temporary.path().join("fresh");
    fs::create_dir(&fresh).map_err(io("make", &fresh))?;
    for (name, content) in files {
        let path = fresh.join(name);
        fs::write(&path, content).map_err(io("write", &path))?;
    }
    let mark = fresh.join(MARK);
    fs::write(&mark, "farreach figures replaces this folder\n").map_err(io("write", &mark))?;
    let old = temporary.path().join("old");
    if folder.exists() {
        fs::rename(folder, &old).map_err(io("replace", folder))?;
    }
    fs::rename(&fresh, folder).map_err(|error| {
        // Restores the old folder; if that fails too, the first error says more.
        let _ = fs::rename(&old, folder);
        io("make", folder)(error)
    })
}

fn beside(folder: &Path) -> Result<tempfile::TempDir> {
    let parent = folder.parent().unwrap_or(folder);
    fs::create_dir_all(parent).map_err(io("make", parent))?;
    tempfile::Builder::new()
        .prefix(".farreach-figures-")
        .tempdir_in(parent)
        .map_err(io("write into", parent))
}

fn is_result(name: &str) -> bool {
    let figure = name
        .strip_prefix("figure-")
        .and_then(|rest| rest.strip_suffix(".svg").or(rest.strip_suffix(".png")));
    [MARK, "index.html", "figures.json", ERRORS_CSV].contains(&name)
        || figure.is_some_and(|number| number.chars().all(|c| c.is_ascii_digit() || c == '.'))
}

fn io(doing: &'static str, path: &Path) -> impl Fn(std::io::Error) -> FiguresError + use<> {
    let path = path.to_owned();
    move |source| FiguresError::Io { doing, path: path.clone(), source }
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
        assert!(
            matches!(&error, FiguresError::NotOurs { found, .. } if found == "index.html"),
            "{error}"
        );
        assert!(matches!(check(&file).unwrap_err(), FiguresError::NotAFolder(_)));
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
        assert!(
            matches!(&error, FiguresError::NotOurs { found, .. } if found == "notes.txt"),
            "{error}"
        );
    }
}

//! Files of a result, and what is printed of it.

use std::io::Write as _;
use std::path::Path;

use anyhow::Context as _;

use crate::error::IdentifyError;
use crate::outcome::{Refusal, RefusalKind};

/// File name for standard output.
const STDOUT: &str = "-";

/// Writes the result for programs, unless it goes to standard output.
pub(crate) fn save(json_file: Option<&Path>, json: &str) -> anyhow::Result<()> {
    match json_file.filter(|path| *path != Path::new(STDOUT)) {
        None => Ok(()),
        Some(path) => make_folder(path)
            .and_then(|()| files::replace(path, json))
            .with_context(|| format!("{}: cannot be written", path.display())),
    }
}

/// Prints the text for readers; where the result for programs goes to standard output, that, and
/// the text to stderr.
pub(crate) fn print(json_file: Option<&Path>, json: &str, text: &str) -> anyhow::Result<()> {
    if json_file == Some(Path::new(STDOUT)) {
        writeln!(std::io::stdout(), "{json}")?;
        eprintln!("{text}");
    } else {
        writeln!(std::io::stdout(), "{text}")?;
    }
    Ok(())
}

/// Tells why there is no result, on stderr and for programs; returns the exit code. The JSON file
/// is replaced, so that the result of an earlier run is not taken for one of this run.
pub(crate) fn refuse(json_file: Option<&Path>, kind: RefusalKind, message: String) -> i32 {
    eprintln!("error: {message}");
    let code = kind.exit_code();
    let Some(path) = json_file else { return code };
    let written = serde_json::to_string_pretty(&Refusal::new(kind, message))
        .map_err(std::io::Error::from)
        .and_then(|json| match path == Path::new(STDOUT) {
            true => writeln!(std::io::stdout(), "{json}"),
            false => make_folder(path).and_then(|()| files::replace(path, json)),
        });
    // The refusal stands, whether or not a program can read of it.
    if let Err(error) = written {
        eprintln!("error: {}: cannot be written: {error}", path.display());
    }
    code
}

/// What an error says cannot be used. An unknown rig name is a usage error, as for `up`.
pub(crate) fn kind_of(error: &anyhow::Error) -> RefusalKind {
    let named = matches!(error.downcast_ref(), Some(rig::FileError::NotShipped { .. }));
    let mapped = matches!(error.downcast_ref(), Some(IdentifyError::Usage(_)));
    if named || mapped { RefusalKind::Usage } else { RefusalKind::Unusable }
}

/// Writes a new file completely or not at all; an existing one is an error.
pub(crate) fn write_new(path: &Path, text: &str) -> std::io::Result<()> {
    make_folder(path)?;
    files::create_new(path, text)
}

/// Makes the folder of the file at `path`, and those above it.
fn make_folder(path: &Path) -> std::io::Result<()> {
    path.parent().map_or(Ok(()), std::fs::create_dir_all)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn a_new_file_never_replaces_another() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("deep").join("a.toml");
        write_new(&path, "one").unwrap();
        assert!(write_new(&path, "two").is_err());
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "one");
    }
}

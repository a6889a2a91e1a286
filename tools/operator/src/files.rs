//! Rig files and protocols: those on disk, and those that are compiled in.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use launch::RunDir;
use rig::RigFile;
use rig::protocol::{Protocol, with_overrides};
use runtime::RigName;

use crate::Error;

/// A file that is compiled in, known by its name without extension.
#[derive(Clone, Copy, Debug)]
pub struct Shipped {
    /// Its name.
    pub name: &'static str,
    /// Its text.
    pub text: &'static str,
}

macro_rules! shipped {
    ($folder:literal: $($name:literal),+ $(,)?) => {
        &[$(Shipped { name: $name, text: include_str!(concat!("../../../launch/", $folder, "/", $name, ".toml")) }),+]
    };
}

/// The rig files of `launch/rigs`.
pub const RIGS: &[Shipped] = shipped!("rigs": "cable", "element", "emps", "hydrostatic", "hydrostatic-printed", "silverbox", "three-axis", "two-axis");
/// The protocols of `launch/protocols`.
pub const PROTOCOLS: &[Shipped] = shipped!("protocols": "circle", "demo", "excitation", "force-fields", "free-movement", "guided-1hz", "initialise", "learning", "learning-model-based", "steps", "three-axes");

/// A word without a folder and without an extension names a shipped file.
fn is_name(asked: &Path) -> bool {
    asked.components().count() == 1 && asked.extension().is_none()
}

fn find(kind: &'static str, list: &'static [Shipped], asked: &Path) -> Result<Option<&'static Shipped>, Error> {
    if !is_name(asked) {
        return Ok(None);
    }
    let found = list.iter().find(|shipped| Path::new(shipped.name) == asked);
    found.map(Some).ok_or_else(|| Error::NotShipped {
        kind,
        found: asked.display().to_string(),
        known: list.iter().map(|shipped| shipped.name).collect(),
    })
}

/// Reads and checks a rig file: a path, or the name of a shipped one (`hydrostatic`).
///
/// # Errors
/// [`Error::NotShipped`], or all that is wrong with the file.
pub fn load_rig(asked: &Path) -> Result<RigFile, Error> {
    Ok(match find("rig", RIGS, asked)? {
        Some(shipped) => RigFile::parse(shipped.text, &format!("{}.toml", shipped.name))?,
        None => RigFile::load(asked)?,
    })
}

/// Reads and checks a protocol with its overrides: a path, or the name of a shipped one (`guided-1hz`).
///
/// # Errors
/// [`Error::NotShipped`], or all that is wrong with the file or the overrides.
pub fn load_protocol(asked: &Path, overrides: &[String]) -> Result<Protocol, Error> {
    Ok(match find("protocol", PROTOCOLS, asked)? {
        Some(shipped) => {
            let file_name = format!("{}.toml", shipped.name);
            Protocol::parse(&with_overrides(shipped.text, &file_name, overrides)?, &file_name)?
        }
        None => Protocol::load_with(asked, overrides)?,
    })
}

/// Puts the text of a rig file into the run directory. All processes read that copy, also those that are started again
/// hours later, so that a rig runs with one file however its original is edited. Its identity stands in its
/// name: a rig file with other contents is another setting, which the launcher sees.
pub(crate) fn keep_copy(run_dir: &Path, asked: &Path, rig: &RigFile) -> Result<PathBuf, Error> {
    let stem = asked.file_stem().and_then(|stem| stem.to_str()).unwrap_or("rig");
    let path = run_dir.join(format!("{stem}.{:016x}.toml", rig.identity()));
    let temporary = path.with_extension("new");
    let io = |path: &Path| {
        let path = path.to_path_buf();
        move |source| Error::Io { doing: "write", path, source }
    };
    fs::write(&temporary, rig.text()).map_err(io(&temporary))?;
    fs::rename(&temporary, &path).map_err(io(&path))?;
    Ok(path)
}

/// What a rig that is up was started with.
///
/// # Errors
/// [`Error::NotUp`] where there is none.
pub fn running(name: &RigName) -> Result<launch::Config, Error> {
    let path = RunDir::new(name.run_directory()).launch_json();
    let text = match fs::read(&path) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Err(Error::NotUp(name.to_string())),
        Err(source) => return Err(Error::Io { doing: "read", path, source }),
    };
    serde_json::from_slice(&text).map_err(|error| Error::Launched { path, reason: error.to_string() })
}

/// The rig file of a rig that is up.
///
/// # Errors
/// [`Error::NotUp`], or what is wrong with the file.
pub fn rig_of(name: &RigName) -> Result<RigFile, Error> {
    let environment: BTreeMap<String, String> = running(name)?.environment;
    match environment.get("FARREACH_RIG") {
        Some(path) => Ok(RigFile::load(path)?),
        None => Err(Error::Launched {
            path: RunDir::new(name.run_directory()).launch_json(),
            reason: "expected FARREACH_RIG among the variables".to_owned(),
        }),
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used)]

    use super::*;

    fn names_in(folder: &str) -> Vec<String> {
        let directory = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../launch").join(folder);
        let mut names: Vec<_> = fs::read_dir(directory)
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .filter(|path| path.extension().is_some_and(|extension| extension == "toml"))
            .map(|path| path.file_stem().unwrap().to_str().unwrap().to_owned())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn every_file_of_the_checkout_is_compiled_in() {
        let names = |list: &[Shipped]| list.iter().map(|shipped| shipped.name.to_owned()).collect::<Vec<_>>();
        assert_eq!(names(RIGS), names_in("rigs"), "add it to operator::RIGS");
        assert_eq!(names(PROTOCOLS), names_in("protocols"), "add it to operator::PROTOCOLS");
    }

    #[test]
    fn shipped_files_load_by_name_and_others_are_named() {
        assert!(load_rig(Path::new("hydrostatic")).is_ok());
        assert!(load_protocol(Path::new("guided-1hz"), &["segments.0.frequency_hz=0.5".to_owned()]).is_ok());
        let error = load_rig(Path::new("hydraulic")).unwrap_err();
        assert_eq!(error.exit_code(), crate::USAGE);
        assert!(error.to_string().contains("hydrostatic-printed"), "{error}");
    }

    #[test]
    fn a_copy_is_named_after_its_contents() {
        let directory = tempfile::tempdir().unwrap();
        let rig = load_rig(Path::new("hydrostatic")).unwrap();
        let path = keep_copy(directory.path(), Path::new("/somewhere/bench.toml"), &rig).unwrap();
        assert!(path.file_name().unwrap().to_str().unwrap().starts_with("bench."));
        assert_eq!(RigFile::load(&path).unwrap().identity(), rig.identity());
        let text = rig.text().replace("10 m line", "11 m line");
        let other = RigFile::parse(&text, "bench.toml").unwrap();
        assert_ne!(keep_copy(directory.path(), Path::new("bench.toml"), &other).unwrap(), path);
    }
}

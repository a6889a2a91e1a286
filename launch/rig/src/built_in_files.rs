//! Rig files and protocols that are compiled in, and loading by name or by path.

use std::borrow::Cow;
use std::path::Path;

use crate::load::text_of;
use crate::protocol::{Protocol, with_overrides};
use crate::{FileError, RigFile};

/// A file that is compiled in.
#[derive(Clone, Copy, Debug)]
pub struct Shipped {
    /// Its name, without extension.
    pub name: &'static str,
    /// Its text.
    pub text: &'static str,
}

macro_rules! shipped {
    ($folder:literal: $($name:literal),+ $(,)?) => {
        &[$(Shipped {
            name: $name,
            text: include_str!(concat!("../../", $folder, "/", $name, ".toml")),
        }),+]
    };
}

/// The rig files of `launch/rigs`.
pub const RIGS: &[Shipped] = shipped!("rigs":
    "cable", "element", "emps", "hydrostatic", "hydrostatic-printed", "silverbox", "three-axis",
    "two-axis",
);
/// The protocols of `launch/protocols`.
pub const PROTOCOLS: &[Shipped] = shipped!("protocols":
    "block-design", "circle", "demo", "emg-matching", "excitation", "force-field-adaptation",
    "force-fields", "force-matching", "free-movement", "friction-map", "guided-1hz", "home",
    "home-three-axes", "home-two-axes", "initialise", "learning", "learning-model-based", "mvc",
    "steps", "three-axes", "tuning-excitation",
);

/// The shipped protocol that homes a rig of so many axes.
pub const fn home_protocol(axes: usize) -> &'static str {
    match axes {
        0 | 1 => "home",
        2 => "home-two-axes",
        _ => "home-three-axes",
    }
}

/// A word without folder and extension is the name of a shipped file.
fn is_name(asked: &Path) -> bool {
    asked.components().count() == 1 && asked.extension().is_none()
}

fn find(
    kind: &'static str,
    list: &'static [Shipped],
    asked: &Path,
) -> Result<Option<&'static Shipped>, FileError> {
    if !is_name(asked) {
        return Ok(None);
    }
    let found = list.iter().find(|shipped| Path::new(shipped.name) == asked);
    found.map(Some).ok_or_else(|| FileError::NotShipped {
        kind,
        found: asked.display().to_string(),
        known: list.iter().map(|shipped| shipped.name).collect(),
    })
}

/// Reads and checks a rig file: a path, or the name of a shipped one (`hydrostatic`).
///
/// # Errors
/// [`FileError::NotShipped`], or every problem in the file.
pub fn load_rig(asked: &Path) -> Result<RigFile, FileError> {
    let (text, file_name) = rig_text(asked)?;
    RigFile::parse(&text, &file_name)
}

/// As [`load_rig`], for a program that needs the declared model alone
/// ([`RigFile::parse_declaration`]).
///
/// # Errors
/// As [`load_rig`].
pub fn load_declaration(asked: &Path) -> Result<RigFile, FileError> {
    let (text, file_name) = rig_text(asked)?;
    RigFile::parse_declaration(&text, &file_name)
}

/// Text and name of a rig file.
fn rig_text(asked: &Path) -> Result<(Cow<'static, str>, String), FileError> {
    match find("rig", RIGS, asked)? {
        Some(shipped) => Ok((shipped.text.into(), format!("{}.toml", shipped.name))),
        None => Ok((text_of(asked)?.into(), asked.display().to_string())),
    }
}

/// Reads and checks a protocol with its overrides: a path, or the name of a shipped one
/// (`guided-1hz`).
///
/// # Errors
/// [`FileError::NotShipped`], or every problem in the file or the overrides.
pub fn load_protocol(asked: &Path, overrides: &[String]) -> Result<Protocol, FileError> {
    match find("protocol", PROTOCOLS, asked)? {
        Some(shipped) => {
            let file_name = format!("{}.toml", shipped.name);
            Protocol::parse(&with_overrides(shipped.text, &file_name, overrides)?, &file_name)
        }
        None => Protocol::load_with(asked, overrides),
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used)]

    use std::fs;

    use super::*;

    fn names_in(folder: &str) -> Vec<String> {
        let directory = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(folder);
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
        let names = |list: &[Shipped]| {
            list.iter().map(|shipped| shipped.name.to_owned()).collect::<Vec<_>>()
        };
        assert_eq!(names(RIGS), names_in("rigs"), "add it to rig::RIGS");
        assert_eq!(names(PROTOCOLS), names_in("protocols"), "add it to rig::PROTOCOLS");
    }

    #[test]
    fn shipped_files_load_by_name_and_others_are_named() {
        assert!(load_rig(Path::new("hydrostatic")).is_ok());
        assert!(
            load_protocol(Path::new("guided-1hz"), &["segments.0.frequency_hz=0.5".to_owned()])
                .is_ok()
        );
        let error = load_rig(Path::new("hydraulic")).unwrap_err();
        assert!(matches!(error, FileError::NotShipped { .. }));
        assert!(error.to_string().contains("hydrostatic-printed"), "{error}");
    }
}

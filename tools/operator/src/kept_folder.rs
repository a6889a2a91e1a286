//! Folders of what outlasts a rig.

use std::path::{Path, PathBuf};

use crate::Error;

/// A folder of what outlasts a rig: where its variable says, else in the user's state directory
/// (the XDG base directories: `~/.local/state`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct KeptFolder {
    /// Environment variable that names it; the processes of a rig get it under this name.
    pub variable: &'static str,
    /// Its path within the state directory.
    within: &'static str,
}

/// Learnt references, maxima of muscles, an interrupted experiment.
pub const LEARNT: KeptFolder =
    KeptFolder { variable: "FARREACH_LEARNT", within: "farreach/learnt" };
/// The reports of `farreach doctor`.
pub const DOCTOR: KeptFolder =
    KeptFolder { variable: "FARREACH_DOCTOR", within: "farreach/doctor" };

impl KeptFolder {
    /// The folder; `None` where the variable is not set and there is no home. It may not exist yet.
    pub fn path(&self) -> Option<PathBuf> {
        self.of(&|name| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from))
    }

    fn of(&self, set: &dyn Fn(&str) -> Option<PathBuf>) -> Option<PathBuf> {
        let state = || set("XDG_STATE_HOME").or_else(|| Some(set("HOME")?.join(".local/state")));
        set(self.variable).or_else(|| Some(state()?.join(self.within)))
    }

    /// The absolute path as text; empty where there is none.
    pub(crate) fn path_text(&self) -> Result<String, Error> {
        self.path().as_deref().map(absolute).transpose().map(Option::unwrap_or_default)
    }
}

/// A path for the processes, whose working directory is `/`.
pub(crate) fn absolute(path: &Path) -> Result<String, Error> {
    let found = std::path::absolute(path).map_err(|source| Error::Io {
        doing: "make absolute",
        path: path.to_path_buf(),
        source,
    })?;
    found.into_os_string().into_string().map_err(|text| Error::Path(text.into()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_variable_goes_before_the_state_directory_and_that_before_home() {
        let of = |names: &'static [&'static str]| {
            DOCTOR.of(&|name| names.contains(&name).then(|| Path::new("/").join(name)))
        };
        let all = &["FARREACH_DOCTOR", "XDG_STATE_HOME", "HOME"];
        assert_eq!(of(all), Some("/FARREACH_DOCTOR".into()));
        assert_eq!(of(&all[1..]), Some("/XDG_STATE_HOME/farreach/doctor".into()));
        assert_eq!(of(&all[2..]), Some("/HOME/.local/state/farreach/doctor".into()));
        assert_eq!(of(&[]), None);
    }
}

//! Reads and checks a rig file.

use std::path::Path;

use crate::check::check;
use crate::checked_toml::Source;
use crate::error::RigError;
use crate::rig_file::{Purpose, RigFile};

impl RigFile {
    /// Reads and checks the file.
    ///
    /// # Errors
    /// [`RigError::Unreadable`] where there is no such file or it is not UTF-8, else as
    /// [`RigFile::parse`].
    pub fn load(path: impl AsRef<Path>) -> Result<Self, RigError> {
        let path = path.as_ref();
        Self::parse(&text_of(path)?, &path.display().to_string())
    }

    /// Checks the text of a rig file; `file_name` appears in messages only.
    ///
    /// # Errors
    /// [`RigError::Invalid`] with every problem found. Checks across sections (rates, phases,
    /// channels against axes) follow when every section is valid by itself.
    pub fn parse(text: &str, file_name: &str) -> Result<Self, RigError> {
        Self::parse_for(text, file_name, Purpose::Run)
    }

    /// As [`RigFile::parse`], for a program that needs the declared model alone: a file that
    /// declares a drive, an oscillator or an element may leave everything but `[model]` out. It is
    /// then named after its file, and has no axes.
    ///
    /// # Errors
    /// As [`RigFile::parse`].
    pub fn parse_declaration(text: &str, file_name: &str) -> Result<Self, RigError> {
        Self::parse_for(text, file_name, Purpose::Identify)
    }

    fn parse_for(text: &str, file_name: &str, purpose: Purpose) -> Result<Self, RigError> {
        let source = Source::new(text, file_name);
        let table = source.parse()?;
        let rig = Self::read(source.root(table.get_ref()), text, file_name, purpose);
        if source.is_clean() {
            check(&rig, &source);
        }
        source.finish()?;
        Ok(rig)
    }
}

/// The text of the file.
pub(crate) fn text_of(path: &Path) -> Result<String, RigError> {
    std::fs::read_to_string(path)
        .map_err(|source| RigError::Unreadable { path: path.to_owned(), source })
}

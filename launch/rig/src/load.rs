//! Reads and checks a rig file.

use std::path::Path;

use crate::check::check;
use crate::checked_toml::Source;
use crate::error::RigError;
use crate::rig_file::RigFile;

impl RigFile {
    /// Reads and checks the file.
    ///
    /// # Errors
    /// [`RigError::Unreadable`] where there is no such file or it is not UTF-8, else as
    /// [`RigFile::parse`].
    pub fn load(path: impl AsRef<Path>) -> Result<Self, RigError> {
        let path = path.as_ref();
        let text = std::fs::read_to_string(path)
            .map_err(|source| RigError::Unreadable { path: path.to_owned(), source })?;
        Self::parse(&text, &path.display().to_string())
    }

    /// Checks the text of a rig file; `file_name` appears in messages only.
    ///
    /// # Errors
    /// [`RigError::Invalid`] with every problem found. Checks across sections (rates, phases,
    /// channels against axes) follow when every section is valid by itself.
    pub fn parse(text: &str, file_name: &str) -> Result<Self, RigError> {
        let source = Source::new(text, file_name);
        let table = source.parse()?;
        let rig = Self::read(source.root(table.get_ref()), text, file_name);
        if source.is_clean() {
            check(&rig, &source);
        }
        source.finish()?;
        Ok(rig)
    }
}

//! Where a rig's console is reached.

use std::fs;
use std::io::ErrorKind;
use std::net::SocketAddr;
use std::path::PathBuf;

use runtime::RigName;
use serde::{Deserialize, Serialize};

use crate::Error;

/// Address of a rig's console, in its run directory, which only the rig's user may enter.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ConsoleAddress {
    /// Address and port that it listens at (`127.0.0.1:8321`).
    pub listen: String,
    /// What a page must show that is to control the rig.
    pub token: String,
}

impl ConsoleAddress {
    fn path(rig: &RigName) -> PathBuf {
        rig.run_directory().join("console.json")
    }

    /// Reads it; `None` where the rig has no console.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn read(rig: &RigName) -> Result<Option<Self>, Error> {
        let path = Self::path(rig);
        let text = match fs::read(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
            Err(source) => return Err(Error::Io { doing: "read", path, source }),
        };
        let read = serde_json::from_slice(&text);
        read.map(Some).map_err(|error| Error::Launched { path, reason: error.to_string() })
    }

    /// Writes it.
    ///
    /// # Errors
    /// The system's.
    pub fn write(&self, rig: &RigName) -> Result<(), Error> {
        let path = Self::path(rig);
        let text = serde_json::json!(self).to_string();
        files::replace(&path, text).map_err(|source| Error::Io { doing: "write", path, source })
    }

    /// Address of the operator's page. The part behind `#` stays in the browser.
    pub fn operator(&self) -> String {
        format!("http://{}/#token={}", self.host(), self.token)
    }

    /// Address of the subject's page.
    pub fn subject(&self) -> String {
        format!("http://{}/subject", self.host())
    }

    /// Where a browser of this computer finds it, also where it listens at all addresses.
    fn host(&self) -> String {
        match self.listen.parse::<SocketAddr>() {
            Ok(at) if at.ip().is_unspecified() => format!("localhost:{}", at.port()),
            _ => self.listen.clone(),
        }
    }
}

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

    /// Address of the operator's page for somebody who only watches: without the token, so that the
    /// page controls nothing. Its plots show the signals of these names; those that they showed
    /// last, where none is given.
    pub fn watching(&self, signals: &[String]) -> String {
        let shown: Vec<_> =
            signals.iter().map(|name| format!("signal={}", escaped(name))).collect();
        let before = if shown.is_empty() { "" } else { "#" };
        format!("http://{}/{before}{}", self.host(), shown.join("&"))
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

/// A name as it stands in an address: other characters than letters, digits, `_`, `-` and `.` as
/// `%` and their bytes.
fn escaped(name: &str) -> String {
    let mut text = String::new();
    for byte in name.bytes() {
        if byte.is_ascii_alphanumeric() || b"_-.".contains(&byte) {
            text.push(char::from(byte));
        } else {
            text += &format!("%{byte:02X}");
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_only_watches_gets_no_token() {
        let address = ConsoleAddress { listen: "0.0.0.0:8321".into(), token: "secret".into() };
        assert_eq!(address.watching(&[]), "http://localhost:8321/");
        let signals = ["handle_torque".to_owned(), "Arm µ&1".to_owned()];
        assert_eq!(
            address.watching(&signals),
            "http://localhost:8321/#signal=handle_torque&signal=Arm%20%C2%B5%261"
        );
        assert!(address.operator().contains("secret"));
    }
}

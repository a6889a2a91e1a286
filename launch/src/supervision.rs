//! Who supervises a rig.

use serde::{Deserialize, Serialize};

/// Who starts, watches and restarts the processes of a rig.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Supervision {
    /// farreach's own launcher.
    #[default]
    Launcher,
    /// systemd, by the unit files.
    Systemd,
}

//! What the launcher reads from others, without the sockets and programs that it comes from: for
//! the fuzz targets.

use crate::control_socket::{Request, request_of};
use crate::{UnitState, notify, systemd};

/// How many notifications a datagram of `sd_notify` has that the launcher acts on.
pub fn notifications(bytes: &[u8]) -> usize {
    notify::parse(bytes).len()
}

/// The units that an output of `systemctl show` describes: state, and how the last process ended.
pub fn units_shown(text: &str) -> Vec<(UnitState, Option<String>)> {
    systemd::show::parse(text).values().map(|shown| (shown.state(), shown.exit())).collect()
}

/// A line of the control socket as request, written again.
///
/// # Errors
/// Why it is none, in words.
pub fn request(line: &[u8]) -> Result<String, String> {
    let request: Request = request_of(line)?;
    serde_json::to_string(&request).map_err(|error| error.to_string())
}

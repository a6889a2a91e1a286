//! What can be wrong with a device, for people.

use rustix::io::Errno;
use thiserror::Error;

/// A device cannot be used as it was asked for.
#[derive(Debug, Error)]
pub enum ComediError {
    /// The node cannot be opened.
    #[error("{device}: cannot be opened: {source}; {}", advice(*source))]
    #[allow(missing_docs)]
    Open { device: String, source: Errno },
    /// The kernel refused a call.
    #[error("{device}: {doing}: {source}{}", busy_advice(*source))]
    #[allow(missing_docs)]
    Refused { device: String, doing: &'static str, source: Errno },
    /// The device is not what the rig file says.
    #[error("{key}: expected {expected}, found {found} at {device}; {advice}")]
    #[allow(missing_docs)]
    Differs { device: String, key: String, expected: String, found: String, advice: &'static str },
}

fn advice(source: Errno) -> &'static str {
    match source {
        Errno::NOENT | Errno::NXIO | Errno::NODEV => {
            "load the card's comedi driver; `dmesg` tells which device it attached"
        }
        Errno::ACCESS | Errno::PERM => {
            "the device is root's: install launch/60-farreach-comedi.rules and join its group"
        }
        _ => "see `dmesg`",
    }
}

fn busy_advice(source: Errno) -> &'static str {
    match source {
        Errno::BUSY | Errno::ACCESS => "; another process, perhaps another rig, uses this card",
        _ => "",
    }
}

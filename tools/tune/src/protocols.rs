//! The protocols of a tuning.

use std::path::Path;

use rig::RigFile;
use rig::protocol::Protocol;

/// The movement that is evaluated, if none is named, and its length.
const MOVEMENT: (&str, &str) = ("guided-1hz", "segments.0.duration_s=12");
/// The movement from which the model is identified, if none is named.
pub(crate) const EXCITATION: &str = "tuning-excitation";

/// The protocols of a tuning, checked against the rig.
#[derive(Clone, Debug)]
pub struct Protocols {
    /// The movement that the handle is to follow.
    pub movement: Protocol,
    /// The movement from which the model is identified.
    pub excitation: Protocol,
}

impl Protocols {
    /// Loads both: files, or names of those that are shipped; `overrides` are of the movement.
    ///
    /// # Errors
    /// What is wrong with a file, or why the rig cannot play it.
    pub fn load(
        movement: Option<&Path>,
        overrides: &[String],
        excitation: &Path,
        rig: &RigFile,
    ) -> anyhow::Result<Self> {
        let (name, length) = MOVEMENT;
        let mut overrides = overrides.to_vec();
        if movement.is_none() {
            overrides.insert(0, length.to_owned());
        }
        let movement = rig::load_protocol(movement.unwrap_or(Path::new(name)), &overrides)?;
        let excitation = rig::load_protocol(excitation, &[])?;
        movement.check_against(rig)?;
        excitation.check_against(rig)?;
        Ok(Self { movement, excitation })
    }

    /// Those that are played if none are named.
    ///
    /// # Errors
    /// Why the rig cannot play them.
    pub fn usual(rig: &RigFile) -> anyhow::Result<Self> {
        Self::load(None, &[], Path::new(EXCITATION), rig)
    }
}

//! The maximum activity of each electrode in a contraction, and the file that keeps it.

use std::fs;
use std::path::{Path, PathBuf};

use emg::MovingMaximum;
use ipc_types::ANALOG;
use rig::{Channel, RigFile};
use serde::{Deserialize, Serialize};

/// Maxima of the rectified signals at the inputs of the card, in the units of their channels; 0
/// where none was measured.
pub type Maxima = [f64; ANALOG];

/// Follows the electrodes through one contraction at a time. Allocates only when it is made.
#[derive(Clone, Debug)]
pub struct Contraction {
    electrodes: Vec<MovingMaximum>,
}

impl Contraction {
    /// For signals that are sampled at `rate_hz`.
    pub fn new(rate_hz: f64) -> Self {
        // A clone would not have the memory for its window.
        Self { electrodes: (0..ANALOG).map(|_| MovingMaximum::new(rate_hz)).collect() }
    }

    /// Begins another contraction.
    pub fn begin(&mut self) {
        self.electrodes.iter_mut().for_each(MovingMaximum::clear);
    }

    /// Takes the rectified signals of a sample; of the inputs, one bit each, that are measured.
    pub fn take(&mut self, inputs: u16, rectified: &[f64; ANALOG]) {
        for (at, electrode) in self.electrodes.iter_mut().enumerate() {
            if inputs & 1 << at != 0 {
                electrode.update(rectified[at]);
            }
        }
    }

    /// The maxima so far.
    pub fn maxima(&self) -> Maxima {
        let mut maxima = [0.0; ANALOG];
        for (maximum, electrode) in maxima.iter_mut().zip(&self.electrodes) {
            *maximum = electrode.largest().unwrap_or(0.0);
        }
        maxima
    }
}

/// The file.
#[derive(Debug, Serialize, Deserialize)]
struct Kept {
    /// What it is, for people.
    about: String,
    electrodes: Vec<KeptElectrode>,
}

#[derive(Debug, Serialize, Deserialize)]
struct KeptElectrode {
    channel: String,
    unit: String,
    maximum: f64,
}

const ABOUT: &str = "Maxima of the rectified signals of electrodes in maximum voluntary \
                     contractions, means over 0.5 s";

/// Where the maxima of that name are.
fn path_of(folder: &Path, name: &str) -> PathBuf {
    folder.join(format!("{name}.emg.json"))
}

/// Keeps the maxima that were measured, whole or not at all.
///
/// # Errors
/// In words; where none was measured, too.
pub fn save(folder: &Path, name: &str, rig: &RigFile, maxima: &Maxima) -> Result<(), String> {
    let electrode = |channel: &Channel| {
        let maximum = maxima.get(channel.index).copied().filter(|maximum| *maximum > 0.0)?;
        let (channel, unit) = (channel.name.clone(), channel.unit.clone());
        Some(KeptElectrode { channel, unit, maximum })
    };
    let electrodes: Vec<_> = rig.channels.iter().filter_map(electrode).collect();
    if electrodes.is_empty() {
        return Err("no electrode's maximum was measured".to_owned());
    }
    let path = path_of(folder, name);
    let told = |error: &dyn std::fmt::Display| format!("{}: {error}", path.display());
    let kept = Kept { about: ABOUT.to_owned(), electrodes };
    let text = serde_json::to_vec_pretty(&kept).map_err(|error| told(&error))?;
    fs::create_dir_all(folder).map_err(|error| told(&error))?;
    files::replace(&path, text).map_err(|error| told(&error))
}

/// The maxima of that name, of every electrode whose muscle belongs to a group.
///
/// # Errors
/// In words: no such file, or an electrode that is not in it or in another unit.
pub fn load(folder: &Path, name: &str, rig: &RigFile) -> Result<Maxima, String> {
    let path = path_of(folder, name);
    let told = |reason: &dyn std::fmt::Display| {
        format!(
            "emg.load: {}: {reason}; measure the maxima with `farreach run mvc --set \
             emg.save={name}`",
            path.display()
        )
    };
    let text = fs::read(&path).map_err(|error| told(&error))?;
    let kept: Kept = serde_json::from_slice(&text).map_err(|error| told(&error))?;
    let mut maxima = [0.0; ANALOG];
    for channel in rig.channels.iter().filter(|channel| channel.group.is_some()) {
        let name = &channel.name;
        let Some(found) = kept.electrodes.iter().find(|found| found.channel == *name) else {
            return Err(told(&format!("expected a maximum of \"{name}\", found none")));
        };
        if found.unit != channel.unit {
            let (expected, found) = (&channel.unit, &found.unit);
            return Err(told(&format!("\"{name}\": expected the unit {expected}, found {found}")));
        }
        if !(found.maximum.is_finite() && found.maximum > 0.0) {
            let found = found.maximum;
            return Err(told(&format!("\"{name}\": expected a maximum above 0, found {found}")));
        }
        if let Some(maximum) = maxima.get_mut(channel.index) {
            *maximum = found.maximum;
        }
    }
    Ok(maxima)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used)]

    use super::*;

    #[test]
    fn maxima_come_back_and_what_is_wrong_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let rig = rig::load_rig(Path::new("hydrostatic")).unwrap();
        let grouped = || rig.channels.iter().filter(|channel| channel.group.is_some());
        let mut maxima = [0.0; ANALOG];
        for channel in grouped() {
            maxima[channel.index] = 0.1 + channel.index as f64;
        }
        save(folder.path(), "s07", &rig, &maxima).unwrap();
        assert_eq!(load(folder.path(), "s07", &rig).unwrap(), maxima);
        let none = load(folder.path(), "s08", &rig).unwrap_err();
        assert!(none.contains("--set emg.save=s08"), "{none}");
        let first = grouped().next().unwrap();
        maxima[first.index] = 0.0;
        save(folder.path(), "s07", &rig, &maxima).unwrap();
        let one_less = load(folder.path(), "s07", &rig).unwrap_err();
        assert!(one_less.contains(&format!("a maximum of \"{}\"", first.name)), "{one_less}");
        let nothing = save(folder.path(), "s07", &rig, &[0.0; ANALOG]).unwrap_err();
        assert!(nothing.contains("no electrode"), "{nothing}");
        fs::write(path_of(folder.path(), "s07"), "{").unwrap();
        assert!(load(folder.path(), "s07", &rig).is_err());
    }
}

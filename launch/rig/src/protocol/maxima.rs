//! `[emg]` of a protocol: maxima of the muscles' activity, measured or used.

use emg::Group;

use super::Segment;
use crate::checked_toml::{Keys, Section, Source};
use crate::rig_file::RigFile;

/// Maxima of the electrodes in maximum voluntary contractions.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MuscleMaxima {
    /// Name under which those that the protocol measures are saved.
    pub save: Option<String>,
    /// Name of saved ones: activity is a share of them.
    pub load: Option<String>,
}

const KEYS: Keys = &[
    ("save", "Name under which the maxima of segments with `contraction` are saved."),
    ("load", "Name of saved maxima: the activity of muscles is then a share of them."),
];

impl MuscleMaxima {
    pub(super) fn read(section: Section<'_>) -> Self {
        section.document("[emg]", KEYS);
        Self { save: section.file_name_or_none("save"), load: section.file_name_or_none("load") }
    }

    /// Checks that the rig has the electrodes; reports the first problem.
    pub(super) fn check(&self, segments: &[Segment], rig: &RigFile, source: &Source<'_>) {
        let contracts = |group| segments.iter().any(|segment| segment.contraction == Some(group));
        for group in Group::ALL.into_iter().filter(|group| contracts(*group)) {
            if !check_electrodes(group, "segments", rig, source) {
                return;
            }
        }
        if self.save.is_some() && !Group::ALL.into_iter().any(contracts) {
            let (expected, found) = ("segments with `contraction`", "none");
            source.problem("emg.save", expected, found, "say which segments measure a maximum");
        }
        if self.load.is_some() && rig.electrodes().is_empty() {
            let (expected, found) = ("electrodes in groups", "none in the rig file");
            source.problem("emg.load", expected, found, "add group to channels of kind emg");
        }
    }
}

/// Checks that the rig has electrodes over a group of muscles; reports a problem with the key where
/// it has none, and returns false.
pub(super) fn check_electrodes(
    group: Group,
    key: &str,
    rig: &RigFile,
    source: &Source<'_>,
) -> bool {
    if rig.muscle_unit(group).is_some() {
        return true;
    }
    let name = group.word();
    let expected = format!("electrodes over {name} muscles");
    let advice = format!("add group = \"{name}\" to channels of kind emg");
    source.problem(key, expected, "none in the rig file", advice)
}

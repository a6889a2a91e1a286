//! `centre`: to the centre of the experiment, and rest there under power (appendix).

use ipc_types::Mode;

use super::hold::{Hold, read_times};
use crate::checked_toml::{Keys, Section};
use crate::protocol::unit_keys::UnitKeys;

/// Moves to the centre of the experiment and rests there under power: a [`Hold`] in a mode of its
/// own.
pub type Centre = Hold;

pub(super) const KEYS: Keys = &[
    ("position_{deg,m}", "Position of the centre; 0, if left out."),
    ("rise_s", "Time of the movement there, part of the duration."),
    ("duration_s", "Whole duration."),
];

pub(super) fn read(section: &Section<'_>, keys: &mut UnitKeys<'_, '_>) -> Centre {
    let (duration_s, rise_s) = read_times(section, 3.0);
    let position = Some(keys.position("position").unwrap_or(0.0));
    Centre { position, rise_s, duration_s, resting: Mode::Centre }
}

//! What breaks in a machine: effects that a simulation begins and ends while the machine moves.
//!
//! They are effects like those of [`super::LIST`], with the same hooks and parameters, but no
//! deviation of an intact machine from its model: rig files do not declare them, and no record is
//! searched for them. Each has a [`Breakdown`], by which it is ended
//! ([`crate::coupled_axes::Plant::end_breakdown`]).

use super::by_name::build;
use super::{Breakdown, Effect, EffectError, Entry, Site};

pub mod hose_rupture;
pub mod seizure;
pub mod slip;

/// Every breakdown.
pub const LIST: &[Entry] = &[hose_rupture::ENTRY, slip::ENTRY, seizure::ENTRY];

/// Makes a breakdown of an entry of [`LIST`] at a site, with a size in its own main unit and a
/// number by which it is ended.
///
/// # Errors
/// [`EffectError::Size`].
pub fn make(
    entry: &'static Entry,
    site: Site,
    size: f64,
    number: u64,
) -> Result<Box<dyn Effect>, EffectError> {
    let mut effect = build(entry, site, size)?;
    if let Some(state) = effect.breakdown_mut() {
        *state = Breakdown { number, ..Breakdown::default() };
    }
    Ok(effect)
}

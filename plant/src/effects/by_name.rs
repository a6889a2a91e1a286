//! Effects by name.

use super::one_channel::OneChannel;
use super::{Effect, Entry, LIST, Site, handle_coupling};
use crate::ParameterError;

/// An effect given as `ID[@SITE][=SIZE]` is invalid.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum EffectError {
    /// No such effect.
    #[error("no effect `{id}`; known: {known}")]
    Unknown {
        /// What was asked for.
        id: String,
        /// All names.
        known: String,
    },
    /// The effect does not act there.
    #[error("effect `{id}` does not act at `{site}`; expected one of: {allowed}")]
    WrongSite {
        /// The effect.
        id: &'static str,
        /// What was asked for.
        site: String,
        /// Where it may act.
        allowed: String,
    },
    /// The size is no number.
    #[error("size of effect `{id}`: expected a number in {unit}, found `{found}`")]
    NotANumber {
        /// The effect.
        id: &'static str,
        /// What was found.
        found: String,
        /// The unit of the size.
        unit: &'static str,
    },
    /// The size is out of range.
    #[error("size of effect `{id}`: {error}")]
    Size {
        /// The effect.
        id: &'static str,
        /// What is wrong.
        error: ParameterError,
    },
}

/// Makes an effect from `ID`, `ID@SITE`, `ID=SIZE` or `ID@SITE=SIZE`.
///
/// # Errors
/// [`EffectError`], which names what is known or allowed.
pub fn parse(text: &str) -> Result<Box<dyn Effect>, EffectError> {
    let (id, site, size) = split(text);
    let entry = find(id)?;
    let place = match site {
        None => entry.sites[0],
        Some(site) => Site::from_name(site)
            .and_then(|site| entry.sites.iter().find(|place| place.site == site).copied())
            .ok_or_else(|| wrong_site(entry, site))?,
    };
    let size = match size {
        None => place.size,
        Some(size) => size.parse::<f64>().map_err(|_| EffectError::NotANumber {
            id: entry.id,
            found: size.to_owned(),
            unit: place.unit,
        })?,
    };
    build(entry, place.site, size)
}

/// The parts of `ID[@SITE][=SIZE]`.
pub fn split(text: &str) -> (&str, Option<&str>, Option<&str>) {
    let (name, size) = match text.split_once('=') {
        Some((name, size)) => (name, Some(size.trim())),
        None => (text, None),
    };
    match name.split_once('@') {
        Some((id, site)) => (id.trim(), Some(site.trim()), size),
        None => (name.trim(), None, size),
    }
}

/// Makes an effect at a site with a size in its own main unit.
///
/// # Errors
/// [`EffectError::Unknown`], [`EffectError::WrongSite`], [`EffectError::Size`].
pub fn make(id: &str, site: Site, size: f64) -> Result<Box<dyn Effect>, EffectError> {
    let entry = find(id)?;
    if !entry.sites.iter().any(|place| place.site == site) {
        return Err(wrong_site(entry, site.name()));
    }
    build(entry, site, size)
}

pub(super) fn build(entry: &Entry, site: Site, size: f64) -> Result<Box<dyn Effect>, EffectError> {
    let mut effect = entry.build.ok_or_else(|| unknown(entry.id))?(site);
    let name = effect.infos()[0].name;
    effect.set(name, size).map_err(|error| EffectError::Size { id: entry.id, error })?;
    Ok(effect)
}

/// The effect of that name as the list has it.
pub fn entry(id: &str) -> Option<&'static Entry> {
    LIST.iter().find(|entry| entry.id == id)
}

/// The effects that a plant can have.
pub fn of_plants() -> impl Iterator<Item = &'static Entry> {
    LIST.iter().filter(|entry| !entry.sites.is_empty())
}

/// Those that a transmission can have by itself, without other axes at its handle.
pub fn of_one_axis() -> impl Iterator<Item = &'static Entry> {
    of_plants().filter(|entry| entry.id != handle_coupling::ENTRY.id)
}

/// The effects in models of one channel, in the order in which they are tried.
pub fn of_one_channel() -> Vec<&'static OneChannel> {
    let mut listed: Vec<_> = LIST.iter().filter_map(|entry| entry.one_channel).collect();
    listed.sort_by_key(|effect| effect.rank);
    listed
}

fn find(id: &str) -> Result<&'static Entry, EffectError> {
    of_plants().find(|entry| entry.id == id).ok_or_else(|| unknown(id))
}

fn unknown(id: &str) -> EffectError {
    EffectError::Unknown {
        id: id.to_owned(),
        known: of_plants().map(|entry| entry.id).collect::<Vec<_>>().join(", "),
    }
}

fn wrong_site(entry: &Entry, site: &str) -> EffectError {
    EffectError::WrongSite {
        id: entry.id,
        site: site.to_owned(),
        allowed: entry.sites.iter().map(|place| place.site.name()).collect::<Vec<_>>().join(", "),
    }
}

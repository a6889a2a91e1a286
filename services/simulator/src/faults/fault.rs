//! A fault as a person asks for it, checked against the rig.

use std::fmt;

use ipc_types::AXES;
use plant::effects::{Site, split};
use rig::{Channel, ChannelKind, RigFile};
use thiserror::Error;

use super::kinds::{Action, FaultKind, LIST, Place, kind};

/// Why a fault is refused.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[allow(missing_docs)]
pub enum FaultError {
    #[error("no fault `{found}`; known: {known}")]
    Unknown { found: String, known: String },
    #[error("fault `{fault}` is in no place of its own: leave out `@{found}`")]
    NoPlace { fault: &'static str, found: String },
    #[error("fault `{fault}` cannot be at `{found}`; expected one of: {allowed}")]
    WrongPlace { fault: &'static str, found: String, allowed: String },
    #[error("fault `{fault}` has no size: leave out `={found}`")]
    NoSize { fault: &'static str, found: String },
    #[error("size of fault `{fault}`: expected {expected}, found `{found}`")]
    Size { fault: &'static str, expected: String, found: String },
    #[error("axis `{found}`: expected a name or number of an axis of the rig: {known}")]
    Axis { found: String, known: String },
    #[error("fault `{fault}@slave`: axis `{axis}` of the rig has no slave encoder")]
    NoSlave { fault: &'static str, axis: String },
    #[error("fault `{fault}`: the rig declares no analog channel")]
    NoChannel { fault: &'static str },
    #[error(
        "fault `{fault}`: no scanner's pulses come from the simulated card; set \
         simulation.trigger_repetition_s in the rig file"
    )]
    NoScanner { fault: &'static str },
    #[error("fault `{fault}`: the rig's transmission is {found}, it needs {expected}")]
    Transmission { fault: &'static str, expected: &'static str, found: &'static str },
    #[error("fault `{fault}`: {found} s: expected a time above 0 and up to 1e6 s")]
    Duration { fault: &'static str, found: String },
    #[error("fault `{fault}` lasts as many scans as its size says: leave out the time")]
    NoDuration { fault: &'static str },
}

/// Where a fault is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum At {
    /// The kind has one place only.
    Only,
    /// At the master.
    Master,
    /// At the slave.
    Slave,
    /// At an analog input, by the card's number.
    Channel(usize),
}

impl At {
    /// Site of a breakdown.
    pub(crate) const fn site(self) -> Site {
        match self {
            Self::Master => Site::Master,
            Self::Slave => Site::Slave,
            Self::Only | Self::Channel(_) => Site::Line,
        }
    }

    /// Index of an encoder: master 0, slave 1.
    pub(crate) const fn encoder(self) -> usize {
        matches!(self, Self::Slave) as usize
    }
}

/// A fault that the rig can have.
#[derive(Clone, Debug)]
pub struct Fault {
    /// Its kind.
    pub kind: &'static FaultKind,
    /// Index of its axis.
    pub axis: usize,
    /// Where it is.
    pub at: At,
    /// Its size, in its unit (of `adc_rail`: V); 0 for a kind without.
    pub size: f64,
    /// Card ticks until it ends by itself.
    pub ticks: Option<u64>,
    /// `KIND[@PLACE][=SIZE]`.
    text: String,
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&self.text)
    }
}

/// Longest time for which a fault may be asked (s).
const LONGEST_S: f64 = 1e6;

impl Fault {
    /// The fault `KIND[@PLACE][=SIZE]` of a rig: on an axis by name or number (the first unless
    /// given), and for a time (s).
    ///
    /// # Errors
    /// [`FaultError`].
    pub fn parse(
        text: &str,
        axis: Option<&str>,
        for_s: Option<f64>,
        rig: &RigFile,
    ) -> Result<Self, FaultError> {
        let (name, place, size) = split(text);
        let kind = find(name)?;
        let axis = axis.map_or(Ok(0), |axis| axis_index(axis, rig))?;
        let at = place_of(kind, place, axis, rig)?;
        let size = size_of(kind, size)?;
        let period_ns = rig.rates.acquisition_period_ns();
        let ticks = match for_s {
            None => None,
            Some(_) if kind.action == Action::FifoOverflow => {
                return Err(FaultError::NoDuration { fault: kind.name });
            }
            Some(for_s) if for_s > 0.0 && for_s <= LONGEST_S => {
                Some(((for_s * 1e9 / period_ns as f64).round() as u64).max(1))
            }
            Some(for_s) => {
                let found = for_s.to_string();
                return Err(FaultError::Duration { fault: kind.name, found });
            }
        };
        let ticks = if kind.action == Action::FifoOverflow { Some(size as u64) } else { ticks };
        let place = match at {
            At::Only => String::new(),
            At::Master => "@master".to_owned(),
            At::Slave => "@slave".to_owned(),
            At::Channel(input) => match rig.channel_at(input) {
                Some(channel) => format!("@{}", channel.name),
                None => format!("@{input}"),
            },
        };
        let shown = if kind.size.is_some() { format!("={size}") } else { String::new() };
        let text = format!("{}{place}{shown}", kind.name);
        let size = match (kind.action, at) {
            (Action::AdcRail, At::Channel(input)) => {
                size * rig.channel_at(input).map_or(1.0, |channel| channel.range_v)
            }
            _ => size,
        };
        Ok(Self { kind, axis, at, size, ticks, text })
    }
}

/// Which faults are meant by `KIND[@PLACE]` on an axis, for their end.
#[derive(Clone, Copy, Debug)]
pub struct FaultFilter {
    kind: Option<&'static FaultKind>,
    at: Option<At>,
    axis: Option<usize>,
}

impl FaultFilter {
    /// The filter; all faults where neither is given.
    ///
    /// # Errors
    /// [`FaultError`].
    pub fn parse(
        text: Option<&str>,
        axis: Option<&str>,
        rig: &RigFile,
    ) -> Result<Self, FaultError> {
        let axis = axis.map(|axis| axis_index(axis, rig)).transpose()?;
        let Some(text) = text else { return Ok(Self { kind: None, at: None, axis }) };
        let (name, place, size) = split(text);
        let kind = find(name)?;
        if let Some(found) = size {
            return Err(FaultError::NoSize { fault: kind.name, found: found.to_owned() });
        }
        let at = place.map(|place| place_of(kind, Some(place), axis.unwrap_or(0), rig));
        Ok(Self { kind: Some(kind), at: at.transpose()?, axis })
    }

    /// Whether a fault is meant.
    pub fn means(&self, fault: &Fault) -> bool {
        self.kind.is_none_or(|kind| kind.action == fault.kind.action)
            && self.at.is_none_or(|at| at == fault.at)
            && self.axis.is_none_or(|axis| axis == fault.axis)
    }
}

fn find(name: &str) -> Result<&'static FaultKind, FaultError> {
    kind(name).ok_or_else(|| FaultError::Unknown {
        found: name.to_owned(),
        known: LIST.iter().map(|kind| kind.name).collect::<Vec<_>>().join(", "),
    })
}

fn axis_index(text: &str, rig: &RigFile) -> Result<usize, FaultError> {
    let count = rig.axes.len().min(AXES);
    let by_number = || text.parse::<usize>().ok().filter(|index| *index < count);
    rig.axes.iter().position(|axis| axis.name == text).or_else(by_number).ok_or_else(|| {
        let names: Vec<&str> = rig.axes.iter().map(|axis| axis.name.as_str()).collect();
        FaultError::Axis { found: text.to_owned(), known: names.join(", ") }
    })
}

/// Where the fault is, and whether the rig has what it needs there.
fn place_of(
    kind: &'static FaultKind,
    place: Option<&str>,
    axis: usize,
    rig: &RigFile,
) -> Result<At, FaultError> {
    let fault = kind.name;
    if let Some(only) = kind.only
        && rig.model.kind.name() != only.name()
    {
        let (expected, found) = (only.name(), rig.model.kind.name());
        return Err(FaultError::Transmission { fault, expected, found });
    }
    if kind.action == Action::TriggerLost && rig.simulation.scanner.is_none() {
        return Err(FaultError::NoScanner { fault });
    }
    let at = match (kind.places, place) {
        ([], None) => At::Only,
        ([], Some(found)) => {
            return Err(FaultError::NoPlace { fault, found: found.to_owned() });
        }
        ([Place::Channel, ..], place) => At::Channel(channel_of(fault, place, axis, rig)?),
        ([first, ..], None) => side(*first),
        (places, Some(found)) => {
            let place = places.iter().find(|place| place.word() == found).ok_or_else(|| {
                let allowed: Vec<_> = places.iter().map(|place| place.word()).collect();
                let allowed = allowed.join(", ");
                FaultError::WrongPlace { fault, found: found.to_owned(), allowed }
            })?;
            side(*place)
        }
    };
    let of_encoder = matches!(
        kind.action,
        Action::EncoderStuck
            | Action::EncoderJump
            | Action::EncoderDropout
            | Action::EncoderReversed
    );
    let entry = rig.axes.get(axis);
    if of_encoder && at == At::Slave && entry.is_none_or(|axis| axis.slave.is_none()) {
        let axis = entry.map_or_else(|| axis.to_string(), |axis| axis.name.clone());
        return Err(FaultError::NoSlave { fault, axis });
    }
    Ok(at)
}

const fn side(place: Place) -> At {
    match place {
        Place::Slave => At::Slave,
        Place::Master | Place::Channel => At::Master,
    }
}

/// The analog input of that name or number; without one that of the axis's torque cell, or else the
/// first.
fn channel_of(
    fault: &'static str,
    place: Option<&str>,
    axis: usize,
    rig: &RigFile,
) -> Result<usize, FaultError> {
    let Some(found) = place else {
        let torque = rig.axes.get(axis).and_then(|axis| axis.torque.as_ref());
        let of_torque = torque.map(|torque| torque.channel);
        let first = || {
            let torque = rig.channels.iter().find(|channel| channel.kind == ChannelKind::Torque);
            torque.or(rig.channels.first()).map(|channel| channel.index)
        };
        return of_torque.or_else(first).ok_or(FaultError::NoChannel { fault });
    };
    let is = |channel: &&Channel| {
        channel.name == found || found.parse().is_ok_and(|index: usize| index == channel.index)
    };
    rig.channels.iter().find(is).map(|channel| channel.index).ok_or_else(|| {
        if rig.channels.is_empty() {
            return FaultError::NoChannel { fault };
        }
        let names: Vec<&str> = rig.channels.iter().map(|channel| channel.name.as_str()).collect();
        FaultError::WrongPlace { fault, found: found.to_owned(), allowed: names.join(", ") }
    })
}

fn size_of(kind: &'static FaultKind, text: Option<&str>) -> Result<f64, FaultError> {
    let fault = kind.name;
    let Some(size) = kind.size else {
        return match text {
            None => Ok(0.0),
            Some(found) => Err(FaultError::NoSize { fault, found: found.to_owned() }),
        };
    };
    let Some(text) = text else { return Ok(size.default) };
    let (least, most) = size.range;
    let fits = |value: &f64| {
        let sign = kind.action != Action::AdcRail || value.abs() == 1.0;
        (least..=most).contains(value) && (!size.whole || value.fract() == 0.0) && sign
    };
    text.parse::<f64>().ok().filter(fits).ok_or_else(|| {
        let number = if size.whole { "a whole number" } else { "a number" };
        let expected = format!("{number} from {least} to {most} ({}, {})", size.what, size.unit);
        FaultError::Size { fault, expected, found: text.to_owned() }
    })
}

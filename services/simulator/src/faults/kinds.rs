//! The kinds of faults: the one list. `docs/faults.md` has it as a table.

use std::fmt;

use ipc_types::TripCause;
use plant::effects::Entry;
use plant::effects::breakdowns::{hose_rupture, seizure, slip};
use plant::transmission_kinds::Kind as Transmission;

/// A kind of fault.
#[derive(Clone, Copy, Debug)]
pub struct FaultKind {
    /// Its name on the command line.
    pub name: &'static str,
    /// Part of the rig in which it acts.
    pub acts: Acts,
    /// What the card or the machine does.
    pub action: Action,
    /// Where it may be, the default first; none for a kind that has one place only.
    pub places: &'static [Place],
    /// Its size; `None` for a kind without.
    pub size: Option<Size>,
    /// What it does to the rig.
    pub what: &'static str,
    /// What is left of it once it is cleared.
    pub after: &'static str,
    /// Transmission that can have it; `None`: any.
    pub only: Option<Transmission>,
    /// What the safety case promises, for each of [`Self::places`]; one where there is none.
    pub promises: &'static [Promise],
}

impl FaultKind {
    /// `KIND[@PLACE]` for each of [`Self::promises`], as the command line takes it; `channel` names
    /// an analog input.
    pub fn texts(&self, channel: &str) -> Vec<String> {
        if self.places.is_empty() {
            return vec![self.name.to_owned()];
        }
        let word = |place: &Place| match place {
            Place::Channel => channel.to_owned(),
            place => place.word().to_owned(),
        };
        self.places.iter().map(|place| format!("{}@{}", self.name, word(place))).collect()
    }
}

/// Part of the rig in which a fault acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Acts {
    CardInput,
    CardOutput,
    EnableLine,
    Drive,
    Line,
    Side,
    Trigger,
}

impl fmt::Display for Acts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::CardInput => "card input",
            Self::CardOutput => "card output",
            Self::EnableLine => "enable line",
            Self::Drive => "drive",
            Self::Line => "line",
            Self::Side => "slave or master",
            Self::Trigger => "trigger",
        })
    }
}

/// What the card or the machine does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Action {
    EncoderStuck,
    EncoderJump,
    EncoderDropout,
    EncoderReversed,
    AdcStuck,
    AdcRail,
    AdcInvalid,
    TriggerLost,
    FifoOverflow,
    DacStuck,
    LineBroken,
    RelayStuck,
    AmplifierDead,
    AmplifierRail,
    MotorReversed,
    HoseRupture,
    CableSlip,
    BeltSlip,
    Seized,
}

impl Action {
    /// The breakdown of the machine that it is; `None` for a fault of the card or the drive.
    pub const fn breakdown(self) -> Option<&'static Entry> {
        match self {
            Self::HoseRupture => Some(&hose_rupture::ENTRY),
            Self::CableSlip | Self::BeltSlip => Some(&slip::ENTRY),
            Self::Seized => Some(&seizure::ENTRY),
            _ => None,
        }
    }
}

/// Where a fault may be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Place {
    Master,
    Slave,
    /// Any analog channel of the rig, by name or number.
    Channel,
}

impl Place {
    /// In the page and in messages.
    pub const fn word(self) -> &'static str {
        match self {
            Self::Master => "master",
            Self::Slave => "slave",
            Self::Channel => "CHANNEL",
        }
    }
}

/// The size of a kind of fault.
#[derive(Clone, Copy, Debug)]
pub struct Size {
    /// What it is.
    pub what: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// Default.
    pub default: f64,
    /// Smallest and largest.
    pub range: (f64, f64),
    /// Whether only whole numbers make sense.
    pub whole: bool,
}

impl Size {
    const fn new(what: &'static str, unit: &'static str, default: f64, range: (f64, f64)) -> Self {
        Self { what, unit, default, range, whole: false }
    }

    const fn whole(self) -> Self {
        Self { whole: true, ..self }
    }

    /// That of a breakdown: its first parameter.
    const fn of(entry: &'static Entry, what: &'static str, unit: &'static str) -> Self {
        let parameter = &entry.parameters[0];
        Self::new(what, unit, entry.sites[0].size, (parameter.minimum, parameter.maximum))
    }
}

/// What the safety case promises of a fault while the motor moves the handle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Promise {
    /// The interlock that looks for it trips by one of these causes; the motor has 0 V at most so
    /// many card ticks after the first scan with the fault, in the realtime profile.
    Trips(&'static [TripCause], u64),
    /// What it causes trips by one of these causes once a limit is passed, which depends on the
    /// movement, or does not.
    AtALimit(&'static [TripCause]),
    /// Nothing trips.
    NotNoticed,
}

use Promise::{AtALimit, NotNoticed, Trips};

/// Card ticks from a scan to 0 V where one message shows a fault: a cycle of acquisition, two of
/// the watchdog (2 ms), one of the gate, the scan that shows it, and one of rounding.
const ONE_MESSAGE: u64 = 8;
/// The same where samples stay away: the line pauses after 3 ms and drops the motor 5 ms later; and
/// rounding.
const SILENCE: u64 = 16 + 4;
const BOTH: &[Place] = &[Place::Master, Place::Slave];
/// What a machine that runs away, stands still or comes apart passes.
const ASTRAY: &[TripCause] = &[
    TripCause::SpeedLimit,
    TripCause::PositionLimit,
    TripCause::TorqueLimit,
    TripCause::EncoderStuck,
    TripCause::Disagreement,
    TripCause::FollowingError,
    TripCause::Saturated,
];

/// What shows that the volts at the motor are those of earlier.
const STANDS_STILL: &[TripCause] =
    &[TripCause::ReadBack, TripCause::SpeedLimit, TripCause::PositionLimit, TripCause::TorqueLimit];

const ANY: FaultKind = FaultKind {
    name: "",
    acts: Acts::CardInput,
    action: Action::EncoderStuck,
    places: &[],
    size: None,
    what: "",
    after: "nothing",
    only: None,
    promises: &[NotNoticed],
};

/// Every kind of fault. Names and places are an interface.
pub const LIST: &[FaultKind] = &[
    FaultKind {
        name: "encoder_stuck",
        action: Action::EncoderStuck,
        places: BOTH,
        what: "the encoder's counter holds its count",
        after: "it counts on from there: its zero has moved",
        promises: &[AtALimit(ASTRAY), AtALimit(ASTRAY)],
        ..ANY
    },
    FaultKind {
        name: "encoder_jump",
        action: Action::EncoderJump,
        places: BOTH,
        size: Some(Size::new("added once", "counts", 1000.0, (-1e9, 1e9)).whole()),
        what: "the encoder's counter jumps, as by interference",
        after: "the zero stays moved",
        promises: &[
            Trips(&[TripCause::EncoderJump, TripCause::HomingLost], ONE_MESSAGE),
            Trips(&[TripCause::EncoderJump, TripCause::HomingLost], ONE_MESSAGE),
        ],
        ..ANY
    },
    FaultKind {
        name: "encoder_dropout",
        action: Action::EncoderDropout,
        places: BOTH,
        what: "the encoder does not answer, and its counts are lost meanwhile",
        after: "it counts on from where it was: its zero has moved",
        promises: &[
            Trips(&[TripCause::SensorInvalid], ONE_MESSAGE),
            Trips(&[TripCause::SensorInvalid], ONE_MESSAGE),
        ],
        ..ANY
    },
    FaultKind {
        name: "encoder_reversed",
        action: Action::EncoderReversed,
        places: BOTH,
        what: "the encoder counts the other way, from its present count on",
        after: "it counts as before, from there: its zero has moved",
        promises: &[AtALimit(ASTRAY), AtALimit(ASTRAY)],
        ..ANY
    },
    FaultKind {
        name: "adc_stuck",
        action: Action::AdcStuck,
        places: &[Place::Channel],
        what: "the analog input holds its last voltage",
        promises: &[NotNoticed],
        ..ANY
    },
    FaultKind {
        name: "adc_rail",
        action: Action::AdcRail,
        places: &[Place::Channel],
        size: Some(Size::new("sign: 1 or -1", "full scale", 1.0, (-1.0, 1.0)).whole()),
        what: "the analog input reads its full scale",
        promises: &[AtALimit(ASTRAY)],
        ..ANY
    },
    FaultKind {
        name: "adc_invalid",
        action: Action::AdcInvalid,
        places: &[Place::Channel],
        what: "the analog input reads not a number",
        promises: &[Trips(&[TripCause::SensorInvalid], ONE_MESSAGE)],
        ..ANY
    },
    FaultKind {
        name: "trigger_lost",
        acts: Acts::Trigger,
        action: Action::TriggerLost,
        what: "the scanner's trigger line stays idle; volumes have no pulse, and are counted",
        promises: &[NotNoticed],
        ..ANY
    },
    FaultKind {
        name: "fifo_overflow",
        action: Action::FifoOverflow,
        size: Some(Size::new("lost in a row", "scans", 100.0, (1.0, 1e6)).whole()),
        what: "the card loses scans; acquisition counts them as missed",
        promises: &[Trips(&[TripCause::AcquisitionLost], SILENCE)],
        ..ANY
    },
    FaultKind {
        name: "dac_stuck",
        acts: Acts::CardOutput,
        action: Action::DacStuck,
        what: "the DAC holds its last voltage, whatever is written; the read-back shows it",
        promises: &[AtALimit(STANDS_STILL)],
        ..ANY
    },
    FaultKind {
        name: "enable_line_broken",
        acts: Acts::EnableLine,
        action: Action::LineBroken,
        what: "no edge of the enable line reaches the card, which drops the motor",
        promises: &[Trips(&[TripCause::ReadBack, TripCause::PowerMissing], SILENCE)],
        ..ANY
    },
    FaultKind {
        name: "relay_stuck",
        acts: Acts::EnableLine,
        action: Action::RelayStuck,
        what: "the motor's relay stays closed once it has closed, whatever the enable line does",
        promises: &[NotNoticed],
        ..ANY
    },
    FaultKind {
        name: "amplifier_dead",
        acts: Acts::Drive,
        action: Action::AmplifierDead,
        what: "the amplifier gives no current; the read-back is at its input and shows nothing",
        promises: &[AtALimit(ASTRAY)],
        ..ANY
    },
    FaultKind {
        name: "amplifier_rail",
        acts: Acts::Drive,
        action: Action::AmplifierRail,
        size: Some(Size::new("as if this were at its input", "V", 10.0, (-100.0, 100.0))),
        what: "the amplifier is stuck at its rail while the motor has power",
        promises: &[AtALimit(ASTRAY)],
        ..ANY
    },
    FaultKind {
        name: "motor_reversed",
        acts: Acts::Drive,
        action: Action::MotorReversed,
        what: "the motor turns the other way",
        promises: &[AtALimit(ASTRAY)],
        ..ANY
    },
    FaultKind {
        name: "hose_rupture",
        acts: Acts::Line,
        action: Action::HoseRupture,
        size: Some(Size::of(&hose_rupture::ENTRY, "time constant of the pressure's fall", "s")),
        what: "both hoses burst: the line's stiffness falls to nothing",
        after: "the line is filled anew: it transmits from where master and slave are",
        only: Some(Transmission::Hydrostatic),
        promises: &[AtALimit(ASTRAY)],
        ..ANY
    },
    FaultKind {
        name: "cable_slip",
        acts: Acts::Line,
        action: Action::CableSlip,
        places: BOTH,
        size: Some(Size::of(&slip::ENTRY, "torque that the pulley still transmits", "N·m")),
        what: "the cable slips on its pulley",
        after: "what it slipped stays",
        only: Some(Transmission::Cable),
        promises: &[AtALimit(ASTRAY), AtALimit(ASTRAY)],
    },
    FaultKind {
        name: "belt_slip",
        acts: Acts::Line,
        action: Action::BeltSlip,
        places: BOTH,
        size: Some(Size::of(&slip::ENTRY, "torque that it still transmits; 0: torn", "N·m")),
        what: "the belt between pulley and piston slips, or is torn",
        after: "what it slipped stays",
        only: Some(Transmission::Hydrostatic),
        promises: &[AtALimit(ASTRAY), AtALimit(ASTRAY)],
    },
    FaultKind {
        name: "seized",
        acts: Acts::Side,
        action: Action::Seized,
        places: &[Place::Slave, Place::Master],
        size: Some(Size::of(&seizure::ENTRY, "friction that holds it", "N·m")),
        what: "the side is stuck",
        promises: &[AtALimit(ASTRAY), AtALimit(ASTRAY)],
        ..ANY
    },
];

/// The kind of that name.
pub fn kind(name: &str) -> Option<&'static FaultKind> {
    LIST.iter().find(|kind| kind.name == name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_unique_and_each_place_has_its_promise() {
        for (at, kind) in LIST.iter().enumerate() {
            assert!(LIST[..at].iter().all(|other| other.name != kind.name), "{}", kind.name);
            assert_eq!(kind.promises.len(), kind.places.len().max(1), "{}", kind.name);
            assert!(!kind.what.is_empty() && !kind.name.contains(['@', '=', ' ']));
            if let Some(size) = kind.size {
                assert!((size.range.0..=size.range.1).contains(&size.default), "{}", kind.name);
            }
        }
    }
}

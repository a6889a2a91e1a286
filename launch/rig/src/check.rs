//! Checks of a rig file that need several of its sections.

mod axis;
mod comedi;
mod declared_model;
mod gains;

use ipc_types::{CardKind, Profile};

use crate::channel::Channel;
use crate::checked_toml::Source;
use crate::comedi_card::ComediCard;
use crate::muscles;
use crate::rig_file::RigFile;
use crate::scanner_line::ScannerLine;
use crate::simulated_scanner;

/// Whether some timing profile can arm the rig; for motors on a real card, the realtime profile.
fn timeouts(rig: &RigFile, source: &Source<'_>) {
    let real = rig.comedi.as_ref().is_some_and(ComediCard::has_outputs);
    let (profile, advice) = match real {
        true => (
            Profile::Realtime,
            "raise the rate, or move phases_us: a real card is armed in the profile realtime only",
        ),
        false => (
            Profile::BestEffort,
            "raise the rate, or move phases_us: no profile has longer timeouts, and the rig could \
             not be armed",
        ),
    };
    if let Some(missed) = rig.missed_timeout(profile) {
        source.problem(missed.key, missed.expected(), missed.found(&rig.rates), advice);
    }
}

/// Checks a file whose sections are each valid by themselves; stability last, as it needs the rest.
pub(crate) fn check(rig: &RigFile, source: &Source<'_>) {
    rig.rates.check(source);
    if source.is_clean() {
        rig.phases.check(&rig.rates, source);
    }
    if source.is_clean() {
        timeouts(rig, source);
    }
    Channel::check_all(&rig.channels, source);
    muscles::check(&rig.emg, &rig.channels, &rig.rates, source);
    declared_model::check(&rig.model, &rig.axes, source);
    ScannerLine::check(rig.scanner.as_ref(), &rig.channels, source);
    match &rig.comedi {
        Some(card) => comedi::check(rig, card, source),
        None if rig.card == Some(CardKind::Comedi) => {
            let advice = "see docs/comedi.md";
            source.problem("card", "a section [comedi] with the wiring", "none", advice);
        }
        None => {}
    }
    if let Some(scanner) = &rig.simulation.scanner {
        simulated_scanner::check(scanner, rig.scanner.as_ref(), &rig.channels, &rig.rates, source);
    }
    for (at, axis) in rig.axes.iter().enumerate() {
        axis::check(axis, at, &rig.channels, &rig.rates, source);
        if let Some(key) = axis.control.options.needs_transmission()
            && !rig.model.kind.is_transmission()
        {
            let found = format!("the model \"{}\"", rig.model.kind.name());
            let expected = "the declared model of a transmission";
            let advice = "take the key out, or declare the transmission in [model]";
            source.problem(&format!("axes.{at}.{key}"), expected, found, advice);
        }
        if let Some(before) = rig.axes[..at].iter().position(|other| other.name == axis.name) {
            let expected = format!("a name of its own (axes.{before} has it already)");
            let found = format!("the text \"{}\"", axis.name);
            let advice = "axis names must be unique";
            source.problem(&format!("axes.{at}.name"), expected, found, advice);
        }
    }
    if source.is_clean() {
        gains::check(rig, source);
    }
}

//! `[emg]`: how the voltages of electrodes become the activity of muscles.

use emg::{Conditioning, Electrode, Group, HIGHEST_SHARE};

use crate::channel::{Channel, ChannelKind};
use crate::checked_toml::{Keys, Section, Source, bounds};
use crate::rates::Rates;

const KEYS: Keys = &[
    ("low_hz", "Lower corner of the band-pass, fourth order."),
    ("high_hz", "Upper corner of the band-pass, fourth order."),
    ("notch_hz", "Frequency of the mains, which a notch takes out; 0: no notch."),
    ("envelope_hz", "Corner of the envelope's low-pass, second order."),
    (
        "artefact_volumes",
        "Volumes over which the scanner's artefact is averaged, to be subtracted; 0: none.",
    ),
];

/// Reads `[emg]`; the defaults where it is not in the file.
pub(crate) fn read(section: Section<'_>) -> Conditioning {
    section.document("[emg]", KEYS);
    let usual = Conditioning::default();
    let low = bounds(1.0, 100.0, "in Hz; movements of the electrodes lie below 10 to 20 Hz");
    let high = bounds(100.0, 5000.0, "in Hz; surface EMG reaches 400 to 500 Hz");
    let notch = bounds(0.0, 1000.0, "in Hz; 50 or 60, or 0 for none");
    let envelope = bounds(0.5, 50.0, "in Hz; usual is 3 to 10");
    let volumes = "0 outside a scanner; usual is 10 to 25";
    let notch_hz = section.number_or("notch_hz", usual.notch_hz.unwrap_or(0.0), notch);
    Conditioning {
        low_hz: section.number_or("low_hz", usual.low_hz, low),
        high_hz: section.number_or("high_hz", usual.high_hz, high),
        notch_hz: (notch_hz > 0.0).then_some(notch_hz),
        envelope_hz: section.number_or("envelope_hz", usual.envelope_hz, envelope),
        artefact_volumes: section.whole_or("artefact_volumes", 0, 0, 100, volumes) as u32,
    }
}

/// The electrodes whose muscles belong to a group.
pub(crate) fn electrodes(channels: &[Channel]) -> Vec<Electrode> {
    let electrode = |channel: &Channel| {
        Some(Electrode { input: channel.index, per_v: channel.per_v, group: channel.group? })
    };
    channels.iter().filter_map(electrode).collect()
}

/// Unit of the activity of a group; `None` where no electrode belongs to it.
pub(crate) fn unit(channels: &[Channel], group: Group) -> Option<&str> {
    let of = |channel: &&Channel| channel.group == Some(group);
    channels.iter().find(of).map(|channel| channel.unit.as_str())
}

/// Checks that the filters fit the rate of acquisition, and that a group has one unit.
pub(crate) fn check(how: &Conditioning, channels: &[Channel], rates: &Rates, source: &Source<'_>) {
    let electrodes = channels.iter().any(|channel| channel.kind == ChannelKind::Emg);
    let most = HIGHEST_SHARE * f64::from(rates.acquisition_hz);
    for (key, found) in [
        ("emg.high_hz", how.high_hz),
        ("emg.notch_hz", how.notch_hz.unwrap_or(0.0)),
        ("emg.envelope_hz", how.envelope_hz),
    ] {
        if electrodes && found > most {
            let expected = format!("at most {most} Hz, {HIGHEST_SHARE} of rates.acquisition_hz");
            source.problem(key, expected, found, "lower it, or sample faster");
        }
    }
    if how.low_hz >= how.high_hz {
        let expected = format!("less than high_hz ({} Hz)", how.high_hz);
        source.problem("emg.low_hz", expected, how.low_hz, "lower it");
    }
    for (at, channel) in channels.iter().enumerate() {
        let Some(group) = channel.group else { continue };
        let Some(unit) = unit(channels, group).filter(|unit| **unit != *channel.unit) else {
            continue;
        };
        let expected = format!("\"{unit}\", as the group's first channel has");
        let found = format!("\"{}\"", channel.unit);
        let advice = "the activity of a group is a mean; per_v scales a channel to its unit";
        source.problem(&format!("channels.{at}.unit"), expected, found, advice);
    }
}

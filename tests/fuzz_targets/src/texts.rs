//! Texts that a person writes: rig files, protocols, values on the command line.

use std::sync::LazyLock;

use ipc_types::PulseSource;
use recording::record::Mapping;
use rig::protocol::{Movement, Protocol, entries, with_overrides};
use rig::{PROTOCOLS, RIGS, RigFile, Shipped};
use runtime::RigName;
use simulator::faults::{Fault, FaultFilter};
use toml_edit::DocumentMut;

use crate::{Outcome, chosen, with_prefixes};

/// Instants of each segment at which its reference is looked at.
const INSTANTS: usize = 8;
/// Segments that are looked at, repeats counted.
const PLAYED: usize = 50;

static RUNNABLE: LazyLock<Vec<RigFile>> = LazyLock::new(|| {
    RIGS.iter().filter_map(|shipped| RigFile::parse(shipped.text, shipped.name).ok()).collect()
});

/// The rigs that come with farreach and can run.
pub(crate) fn rigs() -> &'static [RigFile] {
    &RUNNABLE
}

fn told(error: impl std::fmt::Display) -> String {
    error.to_string()
}

fn of(list: &[Shipped]) -> Vec<Vec<u8>> {
    list.iter().map(|shipped| shipped.text.as_bytes().to_vec()).collect()
}

/// Reads a rig file, to run it and for its model alone.
pub(crate) fn rig_file(bytes: &[u8]) -> Outcome {
    let text = String::from_utf8_lossy(bytes);
    let declared = RigFile::parse_declaration(&text, "fuzz.toml");
    let rig = RigFile::parse(&text, "fuzz.toml").map_err(told)?;
    assert!(declared.is_ok(), "it can be run, yet declares no model: {declared:?}");
    // As `tune` and `identify` write rig files.
    let document: DocumentMut = text.parse().expect("it was read as TOML");
    let again = RigFile::parse(&document.to_string(), "fuzz.toml");
    assert!(again.as_ref().is_ok_and(|again| same_rig(again, &rig)), "it changes: {again:?}");
    Ok(())
}

/// Whether two rig files say the same, whatever their texts.
fn same_rig(one: &RigFile, other: &RigFile) -> bool {
    let of = |rig: &RigFile| {
        format!("{:?} {:?} {:?} {:?}", rig.axes, rig.channels, rig.model, rig.rates)
    };
    of(one) == of(other)
}

pub(crate) fn rig_seeds() -> Vec<Vec<u8>> {
    of(RIGS)
}

/// Reads a protocol, checks it against every rig, and reads its entries.
pub(crate) fn protocol(bytes: &[u8]) -> Outcome {
    let text = String::from_utf8_lossy(bytes);
    let entries = entries(&text, "fuzz.toml").map_err(told)?;
    let protocol = Protocol::parse(&text, "fuzz.toml").map_err(told)?;
    check_protocol(&protocol);
    // As the console writes the values of an entry form.
    let present = entries
        .iter()
        .filter_map(|entry| entry.value.as_ref().map(|value| format!("{}={value}", entry.path)));
    let same: Vec<String> = present.collect();
    let again = with_overrides(&text, "fuzz.toml", &same)
        .and_then(|text| Protocol::parse(&text, "fuzz.toml"));
    match again {
        Ok(again) => assert!(
            again.segments == protocol.segments && again.repeat == protocol.repeat,
            "its own values change it"
        ),
        Err(error) => panic!("it does not take its own values: {error}"),
    }
    Ok(())
}

/// What every protocol that was accepted keeps: a finite duration, and references that are numbers
/// on the rigs that take it.
pub(crate) fn check_protocol(protocol: &Protocol) {
    assert!(protocol.duration_s().is_finite() && protocol.count() > 0, "{}", protocol.text());
    for rig in rigs() {
        if protocol.check_against(rig).is_err() {
            continue;
        }
        let segments = protocol.segments_on(rig);
        let mut starts: Vec<f64> = rig.axes.iter().map(|axis| axis.limits.position_min).collect();
        for (_, segment) in protocol.sequence_of(&segments).take(PLAYED) {
            for (axis, movement) in segment.moves() {
                let (start, duration_s) = (starts[axis], movement.duration_s());
                assert!(duration_s.is_finite() && duration_s >= 0.0, "{}", protocol.text());
                if matches!(movement, Movement::Initialise(_)) || start.is_nan() {
                    continue;
                }
                let peak = movement.feedforward_speed();
                for instant in 0..=INSTANTS {
                    let time_s = duration_s * instant as f64 / INSTANTS as f64;
                    let at = movement.at(start, time_s, peak);
                    let finite = [at.position, at.velocity, at.acceleration];
                    assert!(finite.iter().all(|value| value.is_finite()), "{}", protocol.text());
                }
                starts[axis] = movement.end(Some(start)).unwrap_or(f64::NAN);
            }
        }
    }
}

pub(crate) fn protocol_seeds() -> Vec<Vec<u8>> {
    of(PROTOCOLS)
}

/// Changes values of a shipped protocol, which the first byte chooses: one `KEY=VALUE` a line.
pub(crate) fn overrides(bytes: &[u8]) -> Outcome {
    let (which, bytes) = chosen(bytes, PROTOCOLS.len());
    let text = String::from_utf8_lossy(bytes);
    let lines: Vec<&str> = text.lines().collect();
    let changed = with_overrides(PROTOCOLS[which].text, "shipped.toml", &lines).map_err(told)?;
    let protocol = Protocol::parse(&changed, "shipped.toml").map_err(told)?;
    check_protocol(&protocol);
    Ok(())
}

pub(crate) fn override_seeds() -> Vec<Vec<u8>> {
    let mut seeds = Vec::new();
    for (index, shipped) in PROTOCOLS.iter().enumerate() {
        let entries = entries(shipped.text, shipped.name).expect("it is shipped");
        let set = |entry: &rig::protocol::Entry| {
            let value = entry.value.as_deref().filter(|value| !value.contains('\n'))?;
            Some(format!("{}={value}\n", entry.path))
        };
        let lines: String = entries.iter().filter_map(set).take(12).collect();
        seeds.extend(with_prefixes([index as u8], &[lines.into_bytes()]));
    }
    seeds
}

/// Checks a fault of the hydrostatic rig.
pub(crate) fn fault(text: &str, axis: Option<&str>, for_s: Option<f64>) -> Outcome {
    for rig in rigs() {
        let fault = Fault::parse(text, axis, for_s, rig).map_err(told)?;
        let again = Fault::parse(&fault.to_string(), axis, for_s, rig);
        let same = again.as_ref().is_ok_and(|again| {
            again.to_string() == fault.to_string()
                && (again.at, again.size, again.ticks) == (fault.at, fault.size, fault.ticks)
        });
        assert!(same, "{text} is written as {fault}, which is {again:?}");
    }
    Ok(())
}

/// Checks which faults are to end.
pub(crate) fn fault_filter(text: Option<&str>, axis: Option<&str>) -> Outcome {
    rigs().iter().try_for_each(|rig| FaultFilter::parse(text, axis, rig).map(drop).map_err(told))
}

/// Reads a word of the command line; the first byte chooses which.
pub(crate) fn word(bytes: &[u8]) -> Outcome {
    let (way, bytes) = chosen(bytes, 7);
    let text = String::from_utf8_lossy(bytes);
    match way {
        0 => plant::effects::parse(&text).map(drop).map_err(told),
        1 => fault(&text, None, None),
        2 => fault_filter(Some(&text), Some("0")),
        3 => {
            let source: PulseSource = text.parse().map_err(told)?;
            let again: Result<PulseSource, _> = source.to_string().parse();
            assert!(again.as_ref() == Ok(&source), "{text} is written as {source}");
            experiment::scan_plan::Pulses::of(&source).map(drop)
        }
        4 => {
            let mapping: Mapping = text.parse().map_err(told)?;
            assert!(mapping.factor.is_finite());
            Ok(())
        }
        5 => {
            let name: RigName = text.parse().map_err(told)?;
            // It names a directory.
            assert!(!name.as_str().contains(['/', '.']) && !name.as_str().is_empty());
            Ok(())
        }
        _ => fault(&text, Some("handle"), Some(0.5)),
    }
}

pub(crate) fn word_seeds() -> Vec<Vec<u8>> {
    let mut seeds = Vec::new();
    let mut put = |ways: &[u8], text: &str| {
        seeds.extend(with_prefixes(ways.iter().copied(), &[text.as_bytes().to_vec()]));
    };
    for entry in plant::effects::of_plants() {
        put(&[0], entry.id);
        for place in entry.sites {
            put(&[0], &format!("{}@{}={}", entry.id, place.site.name(), place.size));
        }
    }
    for kind in simulator::faults::LIST {
        put(&[1, 2, 6], kind.name);
        put(&[1, 2, 6], &format!("{}@slave=0.5", kind.name));
    }
    for text in ["line", "key", "2", "2,jitter=0.001,missing=3,spurious=4.5,seed=7"] {
        put(&[3], text);
    }
    put(&[4], "slave_torque_nm=/handle:wrench.torque.z*0.001");
    put(&[5], "bench-2");
    seeds
}

//! Electrodes, their groups and their filters in a rig file.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use emg::{Conditioning, Group};
use rig::RigFile;
use rig::protocol::Protocol;

fn text() -> String {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../rigs/hydrostatic.toml");
    std::fs::read_to_string(path).unwrap()
}

fn refused(from: &str, to: &str) -> String {
    let text = text();
    assert!(text.contains(from), "{from}");
    RigFile::parse(&text.replacen(from, to, 1), "rig.toml").unwrap_err().to_string()
}

#[test]
fn electrodes_have_inputs_scales_and_groups() {
    let text = text().replacen("per_v = 1.0 ", "per_v = 0.5 ", 1);
    let rig = RigFile::parse(&text, "rig.toml").unwrap();
    let electrodes = rig.electrodes();
    let inputs: Vec<_> = electrodes.iter().map(|electrode| electrode.input).collect();
    assert_eq!(inputs, [1, 2, 3, 4, 5, 6]);
    assert_eq!((electrodes[0].per_v, electrodes[1].per_v), (0.5, 1.0));
    assert_eq!((electrodes[0].group, electrodes[1].group), (Group::Agonist, Group::Antagonist));
    assert_eq!(rig.muscle_unit(Group::Agonist), Some("mV"));
    assert_eq!(rig.emg, Conditioning::default(), "the file has the defaults");
}

#[test]
fn what_makes_no_sense_is_refused_with_its_key() {
    for (from, to, parts) in [
        ("per_v = 1.0 ", "per_v = 0.0 ", &["channels.1.per_v", "other than 0"][..]),
        ("unit = \"N·m\"\nrange_v", "unit = \"N·m\"\nper_v = 2.0\nrange_v", &["channels.0.per_v"]),
        ("kind = \"trigger\"", "kind = \"trigger\"\ngroup = \"agonist\"", &["channels.7.group"]),
        ("group = \"antagonist\"", "group = \"flexor\"", &["channels.2.group", "one of"]),
        (
            "name = \"emg_3\"\nkind = \"emg\"\nunit = \"mV\"",
            "name = \"emg_3\"\nkind = \"emg\"\nunit = \"µV\"",
            &["channels.3.unit", "as the group's first channel has"],
        ),
        ("high_hz = 400.0", "high_hz = 950.0", &["emg.high_hz", "at most 900 Hz"]),
        ("artefact_volumes = 0", "artefact_volumes = 101", &["emg.artefact_volumes", "0 to 100"]),
        ("notch_hz = 50.0", "notch = 50.0", &["emg.notch", "notch_hz"]),
    ] {
        let error = refused(from, to);
        assert!(parts.iter().all(|part| error.contains(part)), "{to}: {error}");
    }
    let error = refused("low_hz = 10.0 ", "low_hz = 100.0\nhigh_hz = 100.0 #");
    assert!(error.contains("emg.low_hz") || error.contains("duplicate key"), "{error}");
}

#[test]
fn an_emg_experiment_needs_both_groups() {
    let protocol = rig::PROTOCOLS.iter().find(|shipped| shipped.name == "emg-matching").unwrap();
    let protocol = Protocol::parse(protocol.text, "emg-matching.toml").unwrap();
    protocol.check_against(&RigFile::parse(&text(), "rig.toml").unwrap()).unwrap();
    let without = text().replace("group = \"antagonist\"", "");
    let error = protocol.check_against(&RigFile::parse(&without, "rig.toml").unwrap()).unwrap_err();
    let error = error.to_string();
    assert!(error.contains("matching.signal: expected electrodes over antagonist"), "{error}");
}

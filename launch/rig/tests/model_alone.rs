//! Rig files that declare a model alone, for `farreach identify`.
#![allow(clippy::unwrap_used)]

use rig::{AxisUnit, ForceSource, RigFile, load_declaration, load_rig};

const ROTARY: &str = r#"[model]
kind = "drive"
[model.parameters]
inertia_kg_m2 = { value = 0.01, tolerance = 3.0 }
viscous_friction_nm_s_per_rad = 0.1
torque_offset_nm = { value = 0.0, tolerance_absolute = 0.05 }
torque_per_volt_nm = 0.5
"#;

#[test]
fn a_model_of_one_channel_needs_no_axes_to_be_identified() {
    let rig = RigFile::parse_declaration(ROTARY, "bench/joint.toml").unwrap();
    assert_eq!((rig.name.as_str(), rig.axes.len(), rig.unit()), ("joint", 0, AxisUnit::Radian));
    let inertia = rig.model.parameter("inertia_kg_m2").unwrap();
    assert!((inertia.spread() - 0.03).abs() < 1e-12, "tolerances above 100 %");
    for (kind, parameters) in [
        ("drive", "mass_kg = 1.0\nviscous_friction_n_s_per_m = 0.0"),
        ("element", "stiffness_n_per_m = 1.0\nviscous_damping_n_s_per_m = 0.0"),
        ("oscillator", "mass_s2 = 1e-6\ndamping_s = 1e-4\nstiffness = 1.0"),
    ] {
        let text = format!("[model]\nkind = \"{kind}\"\n[model.parameters]\n{parameters}\n");
        let rig = RigFile::parse_declaration(&text, "part.toml").unwrap();
        assert_eq!((rig.model.kind.name(), rig.unit()), (kind, AxisUnit::Metre));
    }
    let named = RigFile::parse_declaration(&format!("name = \"knee\"\n{ROTARY}"), "a.toml");
    assert_eq!(named.unwrap().name, "knee");
}

#[test]
fn such_a_file_cannot_be_run_and_a_transmission_needs_its_axes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("joint.toml");
    std::fs::write(&path, ROTARY).unwrap();
    assert!(load_declaration(&path).is_ok());
    let error = load_rig(&path).unwrap_err().to_string();
    for part in ["joint.toml:1: axes: expected 1 to 3 axes, found 0", "`farreach identify`"] {
        assert!(error.contains(part), "{error}");
    }
    let text = "name = \"line\"\n[model]\nkind = \"cable\"\n";
    let error = RigFile::parse_declaration(text, "line.toml").unwrap_err().to_string();
    assert!(error.contains("1 to 3 axes, found 0; write each as [[axes]]"), "{error}");
    // Files with axes are read alike by both.
    let emps = load_rig("emps".as_ref()).unwrap();
    assert_eq!(load_declaration("emps".as_ref()).unwrap(), emps);
}

#[test]
fn the_force_is_declared_commanded_or_measured() {
    let with = |force: &str| {
        let text = ROTARY.replace("[model.par", &format!("force = \"{force}\"\n[model.par"));
        RigFile::parse_declaration(&text, "joint.toml").map(|rig| rig.model.force)
    };
    assert_eq!(with("measured").unwrap(), Some(ForceSource::Measured));
    assert_eq!(with("commanded").unwrap(), Some(ForceSource::Commanded));
    let error = with("mesured").unwrap_err().to_string();
    assert!(error.contains("did you mean \"measured\"?"), "{error}");
    let hydrostatic = load_rig("hydrostatic".as_ref()).unwrap();
    let text = hydrostatic.text().replacen("[model]\n", "[model]\nforce = \"measured\"\n", 1);
    let error = RigFile::parse(&text, "rig.toml").unwrap_err().to_string();
    assert!(error.contains("model.force") && error.contains("take the key out"), "{error}");
}

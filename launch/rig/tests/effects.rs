//! `[[model.effects]]`: what measured records showed beyond the equations.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use plant::effects::Site;
use plant::transmission::{Input, Transmission as _};
use rig::RigFile;

const RIG: &str = include_str!("../../rigs/hydrostatic.toml");
const CABLE: &str = include_str!("../../rigs/cable.toml");
const ONE_CHANNEL: [&str; 3] = [
    include_str!("../../rigs/emps.toml"),
    include_str!("../../rigs/element.toml"),
    include_str!("../../rigs/silverbox.toml"),
];

fn with(effects: &str) -> Result<RigFile, String> {
    RigFile::parse(&format!("{RIG}\n{effects}"), "rig.toml").map_err(|error| error.to_string())
}

fn entry(id: &str, site: &str, parameters: &str) -> String {
    format!(
        "[[model.effects]]\nid = \"{id}\"\nsite = \"{site}\"\nparameters = {{ {parameters} }}\n"
    )
}

/// Where the slave stands when the motor has pulled for half a second.
fn pulled(rig: &RigFile) -> f64 {
    let parameters = rig.axis_parameters(&rig.axes[0]).unwrap();
    let mut plant = parameters.plant(rig.model_effects().unwrap()).unwrap();
    plant.step(Input { motor_v: 6.0, hand_torque_nm: 0.0 }, 0.5);
    plant.motion().slave_position_rad
}

#[test]
fn effects_are_read_and_change_the_plant() {
    let rig =
        with(&(entry("backlash", "slave", "gap = 0.06") + &entry("extra_inertia", "slave", "")))
            .unwrap();
    let read: Vec<_> = rig.model.effects.iter().map(|effect| (effect.id, effect.site)).collect();
    assert_eq!(read, [("backlash", Site::Slave), ("extra_inertia", Site::Slave)]);
    let made = rig.model_effects().unwrap();
    assert_eq!(made[0].get("gap"), Some(0.06));
    assert_eq!(made[1].get("inertia"), Some(1e-3), "the list's size where the file gives none");
    let bare = with("").unwrap();
    assert!(bare.model.effects.is_empty());
    assert!((pulled(&rig) - pulled(&bare)).abs() > 0.01, "{} {}", pulled(&rig), pulled(&bare));
}

#[test]
fn the_control_law_knows_what_effects_change_of_its_constants() {
    let bare = with("").unwrap().reflected_dynamics(0).unwrap();
    let identified = |effects: &str| with(effects).unwrap().reflected_dynamics(0).unwrap();
    let softer = identified(&entry("line_compliance", "line", "compliance_ratio = 0.25"));
    assert!((softer.line_v / bare.line_v - 0.8).abs() < 1e-9);
    let per_volt = 1.8;
    let heavier = identified(&entry("extra_inertia", "master", "inertia = 1e-3"));
    assert!((heavier.inertia_v - bare.inertia_v - 1e-3 / per_volt).abs() < 1e-9);
    let rubbing = identified(
        &(entry("coulomb_friction", "master", "level = 0.2")
            + &entry("viscous_friction", "slave", "coefficient = 0.1")),
    );
    let ratio = bare.ratio;
    for speed in [0.5, 3.0, 9.0] {
        let (near, far) =
            (rubbing.master_friction.level_v(speed), rubbing.slave_friction.level_v(speed));
        assert!(
            (near - bare.master_friction.level_v(speed) - 0.2 / per_volt).abs() < 1e-6,
            "{speed}"
        );
        let expected = ratio * ratio * 0.1 * speed / per_volt;
        assert!(
            (far - bare.slave_friction.level_v(speed) - expected).abs() < 0.02 * expected,
            "{speed}"
        );
    }
    // A delay changes no constant.
    assert_eq!(identified(&entry("transport_delay", "line", "delay_s = 5e-3")), bare);
}

#[test]
fn what_cannot_be_is_refused_with_its_key() {
    let refused = |effects: &str| with(effects).unwrap_err();
    let line = RIG.lines().count() + 2;
    let text = refused(&entry("backlesh", "slave", "gap = 0.06"));
    assert!(
        text.starts_with(&format!("rig.toml:{}: model.effects.0.id: expected one of ", line + 1)),
        "{text}"
    );
    assert!(text.contains("found the text \"backlesh\"; did you mean \"backlash\"?"), "{text}");
    let text = refused(&entry("backlash", "drive", "gap = 0.06"));
    assert!(
        text.contains("model.effects.0.site: expected a site of backlash: line, master, slave"),
        "{text}"
    );
    let text = refused(&entry("backlash", "slave", "gapp = 0.06"));
    assert!(
        text.contains("model.effects.0.parameters.gapp: expected a parameter of backlash"),
        "{text}"
    );
    assert!(text.contains("did you mean `gap`?"), "{text}");
    let text = refused(&entry("backlash", "slave", "gap = -1.0"));
    assert!(text.contains("model.effects.0.parameters.gap: expected 0 to"), "{text}");
    let text = refused(&entry("backlash", "slave", "gap = \"wide\""));
    assert!(
        text.contains("model.effects.0.parameters.gap: expected a number, found the text \"wide\""),
        "{text}"
    );
    let text = refused(
        &(entry("backlash", "slave", "gap = 0.06") + &entry("backlash", "slave", "gap = 0.03")),
    );
    assert!(text.contains("model.effects.1.id: expected an effect of its own"), "{text}");
    let text = refused("[[model.effects]]\nid = \"backlash\"\n");
    assert!(text.contains("model.effects.0.site: expected one of"), "{text}");
    let text = refused(&(entry("backlash", "slave", "gap = 0.06") + "size = 3\n"));
    assert!(
        text.contains(
            "model.effects.0.size: expected one of id, parameters, site, found an unknown key"
        ),
        "{text}"
    );
    // A cable does not leak.
    let leaking = format!("{CABLE}\n{}", entry("leakage", "line", "conductance = 1e-12"));
    let text = RigFile::parse(&leaking, "cable.toml").unwrap_err().to_string();
    assert!(
        text.contains("model.effects.0: expected an effect that acts in this transmission"),
        "{text}"
    );
}

#[test]
fn drives_elements_and_oscillators_name_effects_as_transmissions_do() {
    for of_file in ONE_CHANNEL {
        let parse = |effect: &str| RigFile::parse(&format!("{of_file}\n{effect}"), "rig.toml");
        let refused = |effect: &str| parse(effect).unwrap_err().to_string();
        let rig = parse(&entry("coulomb_friction", "slave", "level = 20.4")).unwrap();
        assert_eq!(rig.model_effects().unwrap()[0].get("level"), Some(20.4));
        let text = refused(&entry("coulomb_friction", "slave", "coulomb = 20.4"));
        assert!(
            text.contains(
                "model.effects.0.parameters.coulomb: expected a parameter of coulomb_friction"
            ),
            "{text}"
        );
        let text = refused(&entry("coulomb_friction", "slave", "level = -1.0"));
        assert!(text.contains("model.effects.0.parameters.level: expected 0 to"), "{text}");
        let text = refused(&entry("coulomb_friction", "drive", "level = 20.4"));
        assert!(
            text.contains(
                "model.effects.0.site: expected a site of coulomb_friction: master, slave"
            ),
            "{text}"
        );
    }
}

const TWO: &str = include_str!("../../rigs/two-axis.toml");

/// The two-axis rig with an effect of its second axis, and one of both.
fn of_second(id: &str, parameters: &str, of_both: &str) -> Result<RigFile, String> {
    let own = entry(id, "slave", parameters).replace("model.effects", "axes.effects");
    let text =
        TWO.replace("[[channels]]\nindex = 0\n", &format!("{own}\n[[channels]]\nindex = 0\n"));
    RigFile::parse(&format!("{text}\n{of_both}"), "rig.toml").map_err(|error| error.to_string())
}

#[test]
fn an_axis_may_have_effects_that_the_others_do_not_have() {
    let friction = entry("viscous_friction", "slave", "coefficient = 0.1");
    let rig = of_second("extra_inertia", "inertia = 2e-3", &friction).unwrap();
    let ids = |axis: usize| {
        let made = rig.axis_effects(&rig.axes[axis]).unwrap();
        made.iter().map(|effect| effect.id()).collect::<Vec<_>>()
    };
    assert_eq!(ids(0), ["viscous_friction"]);
    assert_eq!(ids(1), ["viscous_friction", "extra_inertia"]);
    let inertia =
        |axis: usize| rig.control_parameters(&rig.axes[axis]).unwrap().slave_inertia_kg_m2();
    assert!((inertia(1) - inertia(0) - 2e-3).abs() < 1e-12, "the control law knows it, too");
}

#[test]
fn an_effect_of_one_axis_that_cannot_be_is_refused_with_its_key() {
    let friction = entry("viscous_friction", "slave", "coefficient = 0.1");
    let text = of_second("viscous_friction", "", &friction).unwrap_err();
    assert!(
        text.contains("axes.1.effects.0.id: expected an effect of its own (model.effects.0 has it"),
        "{text}"
    );
    let text = of_second("backlash", "gap = -1.0", "").unwrap_err();
    assert!(text.contains("axes.1.effects.0.parameters.gap: expected 0 to"), "{text}");
    // The coupling of a handle is a constant of the handle.
    let text = of_second("handle_coupling", "with_axis_0 = 1e-4", "").unwrap_err();
    assert!(text.contains("axes.1.effects.0.id: expected one of"), "{text}");
}

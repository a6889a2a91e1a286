//! How a rig file says that an axis finds its zero.
#![allow(clippy::unwrap_used)]

use rig::protocol::Protocol;
use rig::{Homing, RigFile};

const RIG: &str = include_str!("../../rigs/hydrostatic.toml");
const HOME: &str = include_str!("../../protocols/home.toml");

fn edited(from: &str, to: &str) -> Result<RigFile, String> {
    assert_eq!(RIG.matches(from).count(), 1, "the edit must hit one place: {from}");
    RigFile::parse(&RIG.replace(from, to), "rig.toml").map_err(|error| error.to_string())
}

#[test]
fn the_stops_and_their_limits_are_read() {
    let rig = RigFile::parse(RIG, "rig.toml").unwrap();
    let search = rig.axes[0].stop_search().unwrap();
    assert!((search.travel() - 170f64.to_radians()).abs() < 1e-12);
    assert!((search.travel_max - 255f64.to_radians()).abs() < 1e-12);
    assert_eq!((search.volts_max, search.time_max_s), (5.0, 60.0));
    // Left out: one and a half times the distance of the stops.
    let without = edited("travel_max_deg = 255.0 ", "# travel_max_deg ").unwrap();
    assert_eq!(without.axes[0].homing, rig.axes[0].homing);
}

#[test]
fn stops_that_cannot_be_are_refused_with_their_keys() {
    for (from, to, expected) in [
        ("method = \"stops\"", "method = \"index\"", "axes.0.homing.method: expected one of"),
        (
            "lower_stop_deg = -85.0",
            "lower_stop_deg = 85.0",
            "axes.0.homing.upper_stop_deg: expected more than 85, found 85; swap the two",
        ),
        (
            "upper_stop_deg = 85.0",
            "upper_stop_deg = 125.0",
            "axes.0.homing.upper_stop_deg: expected within the position limits (-120.0000 to \
             120.0000), found 125",
        ),
        ("lower_stop_deg = -85.0", "lower_stop_m = -0.1", "axes.0.homing.lower_stop_m"),
        ("time_max_s = 60.0", "time_max_s = 0.0", "axes.0.homing.time_max_s: expected a number"),
        ("volts_max = 5.0 ", "volts_max = 50.0 ", "axes.0.homing.volts_max: expected a number"),
    ] {
        let message = edited(from, to).unwrap_err();
        assert!(message.contains(expected), "{to}: {message}");
    }
}

#[test]
fn a_rig_that_gets_power_says_how_its_axes_are_homed() {
    let (before, rest) = RIG.split_once("[axes.homing]").unwrap();
    let (_, after) = rest.split_once("\n\n").unwrap();
    let without = RigFile::parse(&format!("{before}\n{after}"), "rig.toml").unwrap();
    assert_eq!(without.axes[0].homing, None);
    let message = without.check_homing().unwrap_err().to_string();
    assert!(message.contains("axes.0.homing: expected how the axis finds"), "{message}");
    assert!(message.contains("\"handle\"") && message.contains("method = \"stops\""), "{message}");
    let text = format!("{before}[axes.homing]\nmethod = \"absolute\"\n\n{after}");
    let absolute = RigFile::parse(&text, "rig.toml").unwrap();
    assert_eq!(absolute.axes[0].homing, Some(Homing::Absolute));
    assert!(absolute.check_homing().is_ok());
}

#[test]
fn a_search_stays_within_the_limits_of_an_unhomed_axis() {
    let rig = RigFile::parse(RIG, "rig.toml").unwrap();
    let refused = |from: &str, to: &str| {
        let protocol = Protocol::parse(&HOME.replace(from, to), "home.toml").unwrap();
        protocol.check_against(&rig).unwrap_err().to_string()
    };
    let message = refused("volts = 4.0", "volts = 5.5");
    assert!(message.contains("segments.0.volts: expected at most homing.volts_max"), "{message}");
    let slow = edited("speed_max_deg_s = 360.0 ", "speed_max_deg_s = 40.0 ").unwrap();
    let protocol = Protocol::parse(HOME, "home.toml").unwrap();
    let message = protocol.check_against(&slow).unwrap_err().to_string();
    assert!(message.contains("segments.0.speed_deg_s: expected at most homing.speed"), "{message}");
}

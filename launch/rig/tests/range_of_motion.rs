//! The range of motion of a subject: how a rig file gives it, and the protocols that fit it.
#![allow(clippy::unwrap_used)]

use rig::protocol::Protocol;
use rig::{Axis, RangeOfMotion, RigFile};

const RIG: &str = include_str!("../../rigs/hydrostatic.toml");
const TWO: &str = include_str!("../../rigs/two-axis.toml");
const RANGE: &str = "min_deg = -20.0\nmax_deg = 25.0\n";

/// The shipped rig with this section on its axis.
fn with(range: &str) -> Result<RigFile, String> {
    let section = format!("[axes.range_of_motion]\n{range}\n[axes.homing]");
    assert_eq!(RIG.matches("[axes.homing]").count(), 1);
    RigFile::parse(&RIG.replace("[axes.homing]", &section), "rig.toml")
        .map_err(|error| error.to_string())
}

fn protocol(segments: &str) -> Protocol {
    let text = format!("[protocol]\nname = \"test\"\n\n{segments}");
    Protocol::parse(&text, "p.toml").unwrap_or_else(|error| panic!("{error}"))
}

fn steps(degrees: f64) -> Protocol {
    protocol(&format!(
        "[[segments]]\nkind = \"steps\"\npositions_deg = [{degrees:?}]\ndwell_s = 1.0\n"
    ))
}

/// Everything but the unit.
fn close(found: f64, degrees: f64) {
    assert!((found.to_degrees() - degrees).abs() < 1e-9, "{found} rad, not {degrees} degrees");
}

#[test]
fn a_range_is_read_in_the_units_of_its_axis() {
    let shipped = RigFile::parse(RIG, "rig.toml").unwrap();
    assert_eq!(shipped.axes[0].range_of_motion, None);
    let limits = shipped.axes[0].limits;
    assert_eq!(shipped.axes[0].movement_range(), (limits.position_min, limits.position_max));

    let rig = with(RANGE).unwrap();
    let range = rig.axes[0].range_of_motion.unwrap();
    close(range.min, -20.0);
    close(range.max, 25.0);
    close(range.tolerance, 2.0);
    assert_eq!(rig.axes[0].movement_range(), (range.min, range.max));
    // It narrows what a person feels and a protocol may ask for, and no limit of the machine.
    assert_eq!(rig.axes[0].limits, limits);
    assert_eq!(rig.axes[0].plausibility, shipped.axes[0].plausibility);
    let rig = with(&format!("{RANGE}tolerance_deg = 0.5\n")).unwrap();
    close(rig.axes[0].range_of_motion.unwrap().tolerance, 0.5);

    let metres = include_str!("../../rigs/emps.toml");
    let section = "[axes.range_of_motion]\nmin_m = 0.0\nmax_m = 0.05\n\n[axes.limits]";
    assert_eq!(metres.matches("[axes.limits]").count(), 1);
    let rig = RigFile::parse(&metres.replace("[axes.limits]", section), "rig.toml").unwrap();
    let expected = RangeOfMotion { min: 0.0, max: 0.05, tolerance: 0.005 };
    assert_eq!(rig.axes[0].range_of_motion, Some(expected));
}

#[test]
fn a_range_that_cannot_be_is_refused_with_its_keys() {
    for (range, expected) in [
        ("max_deg = 25.0", "range_of_motion.min_deg: expected a number, found nothing"),
        ("min_deg = -20.0", "range_of_motion.max_deg: expected a number, found nothing"),
        (
            "min_deg = 25.0\nmax_deg = -20.0",
            "range_of_motion.max_deg: expected more than min_deg (25), found -20; swap the two",
        ),
        (
            "min_deg = 0.0\nmax_deg = 0.0",
            "range_of_motion.max_deg: expected more than min_deg (0), found 0",
        ),
        ("min_deg = nan\nmax_deg = 25.0", "range_of_motion.min_deg: expected a finite number"),
        ("min_deg = -20.0\nmax_deg = inf", "range_of_motion.max_deg: expected a finite number"),
        (
            "min_deg = -200.0\nmax_deg = 25.0",
            "range_of_motion.min_deg: expected a number from -120 to 120, found -200",
        ),
        ("min_m = -0.1\nmax_deg = 25.0", "range_of_motion.min_m: expected `min_deg`"),
        (
            "min_deg = -20.0\nmax_deg = 25.0\ntolerance_deg = -1.0",
            "range_of_motion.tolerance_deg: expected a number from 0 to 20, found -1",
        ),
        (
            "min_deg = 5.0\nmax_deg = 25.0",
            "range_of_motion.min_deg: expected at most 0, where the handle is once its stops were \
             found, found 5",
        ),
        (
            "min_deg = -25.0\nmax_deg = -5.0",
            "range_of_motion.max_deg: expected at least 0, where the handle is once its stops were \
             found, found -5",
        ),
        (
            "min_deg = -20.0\nmax_deg = 25.0\nlowest = 3",
            "range_of_motion.lowest: expected one of max_deg,",
        ),
    ] {
        let message = with(range).unwrap_err();
        assert!(message.contains(&format!("axes.0.{expected}")), "{range}: {message}");
        assert!(message.starts_with("rig.toml:"), "{message}");
    }
    let narrow = RIG.replace("position_max_deg = 120.0", "position_max_deg = 90.0").replace(
        "[axes.homing]",
        "[axes.range_of_motion]\nmin_deg = -20.0\nmax_deg = 95.0\n\n[axes.homing]",
    );
    let message = RigFile::parse(&narrow, "rig.toml").unwrap_err().to_string();
    let expected = "axes.0.range_of_motion.max_deg: expected within the position limits (-120 to \
                    90), found 95";
    assert!(message.contains(expected), "{message}");
}

/// Absolute encoders need no search, so that their range may lie anywhere within the limits.
#[test]
fn a_range_without_zero_fits_absolute_encoders() {
    let (before, rest) = RIG.split_once("[axes.homing]").unwrap();
    let (_, after) = rest.split_once("\n\n").unwrap();
    let text = format!(
        "{before}[axes.homing]\nmethod = \"absolute\"\n\n[axes.range_of_motion]\nmin_deg = 5.0\n\
         max_deg = 25.0\n\n{after}"
    );
    let rig = RigFile::parse(&text, "rig.toml").unwrap();
    close(rig.axes[0].movement_range().0, 5.0);
}

#[test]
fn the_excess_is_that_of_the_handle() {
    let mut rig = with(RANGE).unwrap();
    let mut sample = ipc_types::Sample { homed: 1, ..ipc_types::Sample::default() };
    let excess = |axis: &Axis, sample: &ipc_types::Sample| {
        (axis.range_excess(0, sample).map(f64::to_degrees), axis.leaves_range(0, sample))
    };
    for (degrees, by, leaves) in
        [(0.0, 0.0, false), (25.0, 0.0, false), (26.9, 1.9, false), (-22.1, 2.1, true)]
    {
        (sample.slave_position[0], sample.master_position[0]) = (f64::to_radians(degrees), 9.0);
        let (found, left) = excess(&rig.axes[0], &sample);
        assert!((found.unwrap() - by).abs() < 1e-9, "{degrees}: {found:?}");
        assert_eq!(left, leaves, "{degrees}");
    }
    // Nothing is said of an unhomed axis, of a position that is none, and without a range.
    let unhomed = ipc_types::Sample { homed: 0b10, ..sample };
    assert_eq!(excess(&rig.axes[0], &unhomed), (None, false));
    sample.slave_position[0] = f64::NAN;
    assert_eq!(excess(&rig.axes[0], &sample), (None, false));
    // Without an encoder at the handle the motor's counts.
    rig.axes[0].slave = None;
    assert!(rig.axes[0].leaves_range(0, &sample));
    rig.axes[0].range_of_motion = None;
    assert_eq!(excess(&rig.axes[0], &sample), (None, false));
}

#[test]
fn a_protocol_keeps_within_the_range_where_one_is_given() {
    let (limits, range) = (RigFile::parse(RIG, "rig.toml").unwrap(), with(RANGE).unwrap());
    for degrees in [-20.0, -3.0, 25.0] {
        assert!(steps(degrees).check_against(&range).is_ok(), "{degrees}");
    }
    for degrees in [-20.1, 25.1, 60.0] {
        assert!(steps(degrees).check_against(&limits).is_ok(), "{degrees}");
        let message = steps(degrees).check_against(&range).unwrap_err().to_string();
        let expected = format!(
            "p.toml:6: segments.0.positions_deg: expected positions from -20.0° to 25.0°, the \
             range of motion of axis 0 (\"handle\"), found a steps from {degrees:.1}° to \
             {degrees:.1}°; move less, or elsewhere; the range is axes.0.range_of_motion of the \
             rig file"
        );
        assert_eq!(message, expected);
    }
    // Every kind with positions of its own.
    for segment in [
        "kind = \"guided_sine\"\namplitude_deg = 23.0\nfrequency_hz = 0.5\nduration_s = 20.0\n",
        "kind = \"hold\"\nposition_deg = 26.0\nduration_s = 5.0\n",
        "kind = \"centre\"\nposition_deg = -21.0\nduration_s = 5.0\n",
        "kind = \"ramp\"\nposition_deg = 26.0\nspeed_deg_s = 20.0\nduration_s = 30.0\n",
        "kind = \"rhythm\"\namplitude_deg = 22.0\nfrequency_hz = 0.5\nduration_s = 20.0\n",
    ] {
        let protocol = protocol(&format!("[[segments]]\n{segment}"));
        protocol.check_against(&limits).unwrap_or_else(|error| panic!("{segment}: {error}"));
        let message = protocol.check_against(&range).unwrap_err().to_string();
        assert!(message.contains("the range of motion of axis 0"), "{segment}: {message}");
    }
}

#[test]
fn each_axis_has_its_own_range() {
    let section = "[axes.range_of_motion]\nmin_deg = -20.0\nmax_deg = 25.0\n\n[axes.homing]";
    let (first, second) = TWO.rsplit_once("[axes.homing]").unwrap();
    let rig = RigFile::parse(&format!("{first}{section}{second}"), "rig.toml").unwrap();
    assert_eq!(rig.axis_bits(|axis| axis.range_of_motion.is_some()), 0b10);
    let on = |axis: usize| {
        protocol(&format!(
            "[[segments]]\nkind = \"steps\"\naxis = {axis}\npositions_deg = [30.0]\n\
             dwell_s = 1.0\n"
        ))
    };
    assert!(on(0).check_against(&rig).is_ok());
    let message = on(1).check_against(&rig).unwrap_err().to_string();
    assert!(message.contains("the range of motion of axis 1"), "{message}");
}

/// A field that drives outwards is held at the ends of the range, where the soft stops are.
#[test]
fn a_diverging_field_is_held_at_the_ends_of_the_range() {
    let free = protocol(
        "[[segments]]\nkind = \"free\"\nspring = -0.5\ncentre_deg = 60.0\nduration_s = 10.0\n",
    );
    let torque_at = |rig: &RigFile| {
        let (least, most) = rig.axes[0].movement_range();
        let force = rig.axes[0].control.force.unwrap();
        (least, most, force.end_stop_width(least, most))
    };
    let wide = with(RANGE).unwrap();
    let (least, most, width) = torque_at(&wide);
    assert!(width < 0.25 * (most - least) + 1e-12 && width > 0.0);
    assert!(free.check_against(&wide).is_ok(), "{:?}", free.check_against(&wide));
    // The stops of a narrow range are narrow, and hold less.
    let narrow = with("min_deg = -1.0\nmax_deg = 1.0\n").unwrap();
    let (least, most, width) = torque_at(&narrow);
    assert!((width - 0.25 * (most - least)).abs() < 1e-12, "{width}");
    let message = free.check_against(&narrow).unwrap_err().to_string();
    assert!(message.contains("outwards at the end of the axis"), "{message}");
}

#[test]
fn a_search_for_the_stops_stands_alone_on_a_rig_with_a_range() {
    const SEARCH: &str = "[[segments]]\nkind = \"initialise\"\nspeed_deg_s = 45.0\nvolts = 4.0\n\
                          duration_s = 30.0\n\n";
    let (limits, range) = (RigFile::parse(RIG, "rig.toml").unwrap(), with(RANGE).unwrap());
    let back = "[[segments]]\nkind = \"hold\"\nposition_deg = 5.0\nduration_s = 4.0\n\n\
                [[segments]]\nkind = \"centre\"\nduration_s = 4.0\n";
    let home = protocol(&format!("{SEARCH}{back}"));
    home.check_against(&range).unwrap_or_else(|error| panic!("{error}"));
    for (more, what) in [
        ("kind = \"rest\"\nduration_s = 5.0\n", "a rest (\"rest 2\")"),
        ("kind = \"free\"\nduration_s = 5.0\n", "a free (\"free 2\")"),
        (
            "kind = \"rhythm\"\nlabel = \"beat\"\namplitude_deg = 5.0\nfrequency_hz = 0.5\n\
             duration_s = 20.0\n",
            "a rhythm (\"beat\")",
        ),
        (
            "kind = \"guided_sine\"\namplitude_deg = 5.0\nfrequency_hz = 0.5\nduration_s = 20.0\n",
            "a guided_sine (\"guided sine 2\")",
        ),
        ("kind = \"hold\"\nsession = true\nduration_s = 20.0\n", "a session (\"hold 2\")"),
    ] {
        let both = protocol(&format!("{SEARCH}[[segments]]\n{more}"));
        both.check_against(&limits).unwrap_or_else(|error| panic!("{more}: {error}"));
        let message = both.check_against(&range).unwrap_err().to_string();
        let expected = "segments.1.kind: expected only initialise, centre and hold, and no \
            session, beside a search for the stops: it leaves the range of motion of axis 0 \
            (\"handle\"), with nobody at the handle, found ";
        assert!(message.contains(&format!("{expected}{what}; home the rig first")), "{message}");
        // Without the search it fits.
        let alone = protocol(&format!("[[segments]]\n{more}"));
        alone.check_against(&range).unwrap_or_else(|error| panic!("{more}: {error}"));
    }
    // A search of an axis without a range exempts all: commands have one mode.
    let section = "[axes.range_of_motion]\nmin_deg = -20.0\nmax_deg = 25.0\n\n[axes.homing]";
    let two = RigFile::parse(&TWO.replacen("[axes.homing]", section, 1), "rig.toml").unwrap();
    let other = protocol(&format!(
        "{}[[segments]]\nkind = \"rest\"\nduration_s = 5.0\n",
        SEARCH.replace("volts = 4.0", "axis = 1\nvolts = 4.0")
    ));
    assert!(other.check_against(&two).unwrap_err().to_string().contains("segments.1.kind"));
}

/// What comes with farreach homes a rig with a range; what searches and goes on with a subject is
/// refused.
#[test]
fn the_shipped_protocols_that_home_fit_a_rig_with_a_range() {
    let section = "[axes.range_of_motion]\nmin_deg = -20.0\nmax_deg = 25.0\n\n[axes.homing]";
    for name in ["hydrostatic", "two-axis", "three-axis"] {
        let shipped = rig::RIGS.iter().find(|shipped| shipped.name == name).unwrap();
        let text = shipped.text.replace("[axes.homing]", section);
        let rig = RigFile::parse(&text, "rig.toml").unwrap_or_else(|error| panic!("{error}"));
        let home = rig::load_protocol(rig::home_protocol(rig.axes.len()).as_ref(), &[]).unwrap();
        home.check_against(&rig).unwrap_or_else(|error| panic!("{name}: {error}"));
        let initialise = rig::load_protocol("initialise".as_ref(), &[]).unwrap();
        let message = initialise.check_against(&rig).unwrap_err().to_string();
        assert!(message.contains("segments.2.kind: expected only initialise, centre"), "{message}");
    }
}

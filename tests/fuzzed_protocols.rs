//! Protocols that are broken at random: nothing panics, what is accepted stays within the rig's
//! limits, and what is refused moves no motor.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::time::Duration;

use ipc_types::{
    EXPERIMENT_COMMANDS, ExperimentAnswer, ExperimentRequest, Mode, MotorCommand, PulseSource,
    Sample,
};
use recording::mcap_read::Recording;
use rig::protocol::{Movement, Protocol};
use rig::{PROTOCOLS, RIGS, RigFile};

use common::mutated::{Numbers, mutated};
use common::playing::messages;
use common::{TestRig, told};

const TEXTS: usize = 10_000;
/// Those that a rig is asked to play: it answers 160 in a second.
const PLAYED: usize = 2_500;
/// Instants of each segment at which its reference is looked at.
const INSTANTS: usize = 40;
const LIMIT: Duration = Duration::from_secs(20);
/// Samples after which a handle that was switched on in movement is at rest.
const SETTLING: usize = 4000;
/// Largest movement of a handle that is held: it creeps a few counts of its encoder within a
/// minute, where a movement sweeps a radian (rad).
const HELD: f64 = 0.05;
/// Rounding, as a share of a limit.
const ROUNDING: f64 = 1e-9;

/// The broken protocols; one in twenty is as shipped.
fn texts(seed: u64) -> impl Iterator<Item = String> {
    let shipped: Vec<&str> = PROTOCOLS.iter().map(|protocol| protocol.text).collect();
    let mut numbers = Numbers(seed);
    (0..TEXTS).map(move |_| {
        let text = shipped[numbers.below(shipped.len())];
        if numbers.below(20) == 0 { text.to_owned() } else { mutated(text, &shipped, &mut numbers) }
    })
}

/// Plays a protocol that was accepted, from a start that is allowed, and compares every reference
/// with the limits.
fn stays_within_limits(protocol: &Protocol, rig: &RigFile, numbers: &mut Numbers, text: &str) {
    let segments = protocol.segments_on(rig);
    let mut starts: Vec<f64> = rig
        .axes
        .iter()
        .map(|axis| {
            let share = numbers.below(1001) as f64 / 1000.0;
            axis.limits.position_min + share * (axis.limits.position_max - axis.limits.position_min)
        })
        .collect();
    // A protocol of many repeats is the same again and again.
    for (index, segment) in protocol.sequence_of(&segments).take(200) {
        for (axis, movement) in segment.moves() {
            let limits = &rig.axes[axis].limits;
            let (start, peak) = (starts[axis], movement.feedforward_speed());
            let duration_s = movement.duration_s();
            assert!(duration_s.is_finite() && duration_s >= 0.0, "segment {index} of {text}");
            // Homing seeks the stops, within limits of its own.
            if matches!(movement, Movement::Initialise(_)) || start.is_nan() {
                continue;
            }
            for instant in 0..=INSTANTS {
                let at = movement.at(start, duration_s * instant as f64 / INSTANTS as f64, peak);
                let inside = at.position >= limits.position_min - ROUNDING
                    && at.position <= limits.position_max + ROUNDING
                    && at.velocity.abs() <= limits.speed_max * (1.0 + ROUNDING)
                    && at.acceleration.is_finite();
                assert!(inside, "{at:?} of segment {index} on axis {axis} of {text}");
            }
            // NaN where the hand leaves it somewhere.
            starts[axis] = movement.end(Some(start)).unwrap_or(f64::NAN);
        }
    }
}

#[test]
fn what_is_accepted_stays_within_the_limits_and_what_is_not_is_told() {
    let rigs: Vec<RigFile> =
        RIGS.iter().filter_map(|shipped| RigFile::parse(shipped.text, shipped.name).ok()).collect();
    assert!(rigs.len() >= 3);
    let mut numbers = Numbers(3);
    let (mut accepted, mut refused) = (0, 0);
    for text in texts(20_261_126) {
        let protocol = match Protocol::parse(&text, "broken.toml") {
            Ok(protocol) => protocol,
            Err(error) => {
                let told = error.to_string();
                assert!(told.contains("broken.toml"), "{told}");
                refused += 1;
                continue;
            }
        };
        assert!(protocol.duration_s().is_finite() && protocol.count() > 0, "{text}");
        let fits = |rig: &&RigFile| match protocol.check_against(rig) {
            Ok(()) => true,
            Err(error) => {
                assert!(error.to_string().contains("broken.toml"), "{error}");
                false
            }
        };
        if let Some(rig) = rigs.iter().find(fits) {
            stays_within_limits(&protocol, rig, &mut numbers, &text);
            accepted += 1;
        }
    }
    // Enough of either to mean something.
    assert!(
        accepted > TEXTS / 10 && refused > TEXTS / 10,
        "{accepted} accepted, {refused} refused"
    );
}

#[test]
fn what_is_refused_moves_no_motor() {
    let rig = TestRig::patient("fuzzed-protocols");
    rig.up_homed();
    let file = rig.path("fuzzed.mcap");
    rig.power_up();
    rig.ok(["rec", "start", file.to_str().unwrap()]);
    let pid = || rig.launcher_status().unit("experiment").unwrap().process.unwrap().pid;
    let before = pid();
    let domain = runtime::Domain::observe(rig.name()).unwrap();
    let node = domain.node("fuzzer").unwrap();
    let ask = |request: &ExperimentRequest| -> ExperimentAnswer {
        runtime::call(&node, &EXPERIMENT_COMMANDS, request, LIMIT).unwrap()
    };
    let declared = rig::load_rig(rig.absolute_rig("hydrostatic").as_ref()).unwrap();
    let mut refused = 0;
    for (number, protocol) in (0..).zip(texts(7).take(PLAYED)) {
        let name = "broken.toml".to_owned();
        let read = Protocol::parse(&protocol, &name);
        let fits = read.is_ok_and(|protocol| protocol.check_against(&declared).is_ok());
        let pulses = PulseSource::Line;
        if fits {
            // It could be played: that is another test.
            let answer = ask(&ExperimentRequest::Check { protocol, name, pulses });
            assert!(!answer.running, "{answer:?}");
            continue;
        }
        let run = ExperimentRequest::Run { protocol, name, client: number, pulses };
        let answer = ask(&run);
        assert!(!answer.running && !answer.error.is_empty(), "{answer:?}");
        assert!(!answer.error.contains("root:"), "it shows a file of the machine");
        refused += 1;
    }
    assert!(refused > PLAYED / 10, "{refused}");
    assert_eq!(pid(), before, "it was started again: {}", rig.why("experiment"));
    rig.ok(["rec", "stop"]);
    let recording = Recording::open(&file).unwrap();
    let commands: Vec<MotorCommand> = messages(&recording, "command");
    let samples: Vec<Sample> = messages(&recording, "sample");
    assert!(commands.len() > 1000 && samples.len() > 4000, "{}", told(&rig.run(["status"])));
    // Power without a protocol holds the handle where it is.
    let follows = |command: &&MotorCommand| {
        !matches!(Mode::from_code(command.mode), Some(Mode::Passive | Mode::Hold))
            || command.setpoint_sequence > 0
    };
    assert_eq!(commands.iter().find(follows), None, "a setpoint was followed");
    let settled = samples.iter().skip(SETTLING).map(|sample| sample.master_position[0]);
    let (least, most) = settled.fold((f64::MAX, f64::MIN), |(least, most), position| {
        (least.min(position), most.max(position))
    });
    assert!(most - least < HELD, "from {least} to {most}");
    rig.down();
}

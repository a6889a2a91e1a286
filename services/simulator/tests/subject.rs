//! The simulated subject: reaction, effort, and a bar that it brings to its middle.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::path::Path;

use ipc_types::{AXES, Light, Performance};
use rig::{Hand, HandKind, RigFile};
use simulator::Subject;

const MS: u64 = 1_000_000;
const SECOND: u64 = 1_000 * MS;

fn hand(variability: f64) -> Hand {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../launch/rigs/hydrostatic.toml");
    let rig = RigFile::load(Path::new(path)).unwrap();
    Hand { kind: HandKind::Subject, variability, ..rig.simulation.hand }
}

fn shown(at_ns: u64, light: Light, update: u32, height: Option<[f64; 2]>) -> Performance {
    Performance {
        at_ns,
        begun_ns: SECOND,
        light: light.code(),
        update,
        bars: if height.is_some() { 2 } else { 0 },
        height: height.unwrap_or_default(),
        ..Performance::default()
    }
}

fn torque(subject: &mut Subject, position: f64, now_ns: u64) -> f64 {
    subject.torques(&[(position, 0.0); AXES], 0.0, now_ns)[0]
}

#[test]
fn it_moves_about_where_the_handle_was_under_a_green_light_only() {
    let mut subject = Subject::new(hand(0.0), 1);
    let stiffness = hand(0.0).stiffness;
    // Relaxed: little pulls the handle to 0.
    assert!((torque(&mut subject, 0.2, 0) + 0.1 * stiffness * 0.2).abs() < 1e-12);
    subject.see(&shown(SECOND, Light::Green, 0, None));
    // Nothing happens within the reaction time.
    assert!((torque(&mut subject, 0.2, 1_249 * MS) + 0.1 * stiffness * 0.2).abs() < 1e-12);
    // Then it begins where the handle is, and moves about that place.
    let torques: Vec<f64> =
        (0..4000).map(|k| torque(&mut subject, 0.2, 1_250 * MS + k * MS)).collect();
    assert!(torques[0].abs() < 0.05, "{}", torques[0]);
    let largest = torques[1000..].iter().copied().fold(0.0, f64::max);
    let least = torques[1000..].iter().copied().fold(0.0, f64::min);
    let expected = stiffness * hand(0.0).amplitude;
    assert!((largest / expected - 1.0).abs() < 0.5 && (largest + least).abs() < 0.02 * expected);
    subject.see(&shown(6 * SECOND, Light::Red, 0, None));
    assert!((torque(&mut subject, 0.2, 7 * SECOND) + 0.1 * stiffness * 0.2).abs() < 1e-12);
}

#[test]
fn it_brings_the_lower_bar_to_the_middle() {
    for (variability, within) in [(0.0, 0.05), (0.05, 2.5)] {
        let mut subject = Subject::new(hand(variability), 3);
        subject.see(&shown(SECOND, Light::Green, 0, None));
        // The bars rise with the effort; the target asks for 1.7 times that of the beginning.
        let mut heights = Vec::new();
        for update in 1..=60u32 {
            let at_ns = SECOND + u64::from(update) * SECOND / 2;
            let height = (10.0 * subject.effort() / 1.7).min(19.0);
            subject.see(&shown(at_ns, Light::Green, update, Some([height, height + 3.0])));
            // The same update is shown again and again until the next.
            subject.see(&shown(
                at_ns + 20 * MS,
                Light::Green,
                update,
                Some([height, height + 3.0]),
            ));
            let before = subject.effort();
            torque(&mut subject, 0.0, at_ns + 249 * MS);
            assert_eq!(subject.effort(), before, "within the reaction time");
            torque(&mut subject, 0.0, at_ns + 251 * MS);
            heights.push(height);
        }
        let settled = &heights[30..];
        let mean = settled.iter().sum::<f64>() / settled.len() as f64;
        assert!((mean - 10.0).abs() < within, "{mean}");
        assert!(settled.iter().all(|height| (height - 10.0).abs() < 4.0), "{settled:?}");
    }
}

#[test]
fn what_is_shown_in_a_rest_changes_nothing_and_equal_seeds_give_equal_subjects() {
    let run = |seed: u64| {
        let mut subject = Subject::new(hand(0.05), seed);
        for update in 1..20u32 {
            let at_ns = SECOND + u64::from(update) * SECOND;
            subject.see(&shown(at_ns, Light::Red, update, Some([4.0, 4.0])));
            torque(&mut subject, 0.0, at_ns + SECOND / 2);
        }
        assert_eq!(subject.effort(), 1.0);
        subject.see(&shown(30 * SECOND, Light::Green, 1, Some([4.0, 4.0])));
        torque(&mut subject, 0.0, 31 * SECOND);
        subject.effort()
    };
    assert_eq!(run(5), run(5));
    assert_ne!(run(5), run(6));
}

#[test]
fn other_hands_are_as_they_were() {
    let passive = Hand { kind: HandKind::Passive, ..hand(0.0) };
    let mut subject = Subject::new(passive, 1);
    subject.see(&shown(SECOND, Light::Green, 0, None));
    assert_eq!(torque(&mut subject, 0.2, 9 * SECOND), passive.torque(0.2, 0.0, 0.0));
}

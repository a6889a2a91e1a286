//! Movements: exact derivatives, smooth joins, bounds.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::f64::consts::TAU;

use experiment::prepared_movement::PreparedMovement;
use ipc_types::Mode;
use proptest::prelude::*;
use rig::protocol::trajectory::{Point, stopping};
use rig::protocol::{
    Centre, Chirp, Envelope, GuidedSine, Hold, Line, Movement, Multisine, Ramp, Rest, Steps,
};

fn envelopes() -> impl Strategy<Value = Envelope> {
    (-0.5..0.5_f64, 0.1..3.0_f64, 0.1..3.0_f64, 0.0..5.0_f64).prop_map(
        |(centre, fade_in_s, fade_out_s, full)| Envelope {
            centre,
            duration_s: fade_in_s + fade_out_s + full,
            fade_in_s,
            fade_out_s,
        },
    )
}

fn movements() -> impl Strategy<Value = Movement> {
    let line = (0.001..0.3_f64, 0.05..10.0_f64, 0.0..TAU)
        .prop_map(|(amplitude, frequency_hz, phase)| Line { amplitude, frequency_hz, phase });
    prop_oneof![
        (0.01..1.0_f64, 0.2..3.0_f64, envelopes()).prop_map(
            |(amplitude, frequency_hz, envelope)| {
                let line = Line { amplitude, frequency_hz, phase: 0.0 };
                Movement::GuidedSine(GuidedSine { line, envelope })
            }
        ),
        (prop::collection::vec(line, 1..8), envelopes())
            .prop_map(|(lines, envelope)| Movement::Multisine(Multisine { lines, envelope })),
        (prop::collection::vec(-1.0..1.0_f64, 1..6), 0.1..2.0_f64, 0.1..2.0_f64).prop_map(
            |(positions, dwell_s, rise_s)| Movement::Steps(Steps { positions, dwell_s, rise_s })
        ),
        (prop::option::of(-1.0..1.0_f64), 0.1..1.0_f64, 0.0..2.0_f64).prop_map(
            |(position, rise_s, more)| Movement::Hold(Hold {
                position,
                rise_s,
                duration_s: rise_s + more + 0.1,
                resting: Mode::Hold,
            })
        ),
        (0.1..5.0_f64).prop_map(|duration_s| Movement::Rest(Rest { duration_s })),
        (-1.0..1.0_f64, 0.1..1.0_f64, 0.0..2.0_f64).prop_map(|(position, rise_s, more)| {
            Movement::Centre(Centre {
                position: Some(position),
                rise_s,
                duration_s: rise_s + more,
                resting: Mode::Centre,
            })
        }),
        (-1.0..1.0_f64, 0.2..3.0_f64, 0.1..0.5_f64, 0.0..2.0_f64).prop_map(
            |(position, speed, ease_s, more)| {
                Movement::Ramp(Ramp {
                    position,
                    speed,
                    ease_s,
                    duration_s: 2.0 / speed + 2.0 * ease_s + more,
                })
            }
        ),
        (0.01..0.3_f64, [0.1..5.0_f64, 0.1..5.0_f64], any::<bool>(), envelopes()).prop_map(
            |(amplitude, frequencies_hz, exponential, envelope)| {
                Movement::Chirp(Chirp { amplitude, frequencies_hz, exponential, envelope })
            }
        ),
    ]
}

/// Scales against which small differences are judged: speed and acceleration that the movement can
/// reach.
fn scales(track: &PreparedMovement, start: f64) -> (f64, f64) {
    let points: Vec<_> =
        (0..=2000).map(|i| track.at(start, track.duration_s() * f64::from(i) / 2000.0)).collect();
    let speed = points.iter().map(|point| point.velocity.abs()).fold(0.0, f64::max);
    let acceleration = points.iter().map(|point| point.acceleration.abs()).fold(0.0, f64::max);
    (speed, acceleration)
}

/// Lowest and highest position of a movement and its start.
fn hull(movement: &Movement, start: f64) -> (f64, f64) {
    movement.range().map_or((start, start), |(low, high)| (low.min(start), high.max(start)))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn velocity_is_the_derivative_of_position_and_acceleration_of_velocity(
        movement in movements(), start in -1.0..1.0_f64, part in 0.0..1.0_f64,
    ) {
        let track = PreparedMovement::new(movement);
        let h = 1e-5;
        let t = h + part * (track.duration_s() - 2.0 * h);
        let [before, here, after] = [t - h, t, t + h].map(|t| track.at(start, t));
        let (speed, acceleration) = scales(&track, start);
        let velocity = (after.position - before.position) / (2.0 * h);
        prop_assert!((velocity - here.velocity).abs() < 1e-3 * speed + 1e-6, "{velocity} {here:?}");
        // central difference; the jerk jumps where a blend begins, hence h times a jerk of ω a
        let slope = (after.velocity - before.velocity) / (2.0 * h);
        let most = 2e-2 * acceleration + 1e-6;
        prop_assert!((slope - here.acceleration).abs() < most, "{slope} {here:?}");
    }

    #[test]
    fn it_begins_and_ends_at_rest_where_it_says(movement in movements(), start in -1.0..1.0_f64) {
        let end = movement.end(Some(start)).unwrap_or(start);
        let track = PreparedMovement::new(movement);
        let (speed, acceleration) = scales(&track, start);
        for (t, position) in [(0.0, start), (track.duration_s(), end)] {
            let point = track.at(start, t);
            prop_assert!((point.position - position).abs() < 1e-9, "{point:?} {position}");
            prop_assert!(point.velocity.abs() <= 1e-6 * speed, "{point:?}");
            prop_assert!(point.acceleration.abs() <= 1e-6 * acceleration, "{point:?}");
        }
    }

    #[test]
    fn it_stays_in_its_range_and_below_its_speed_bound(
        movement in movements(), start in -1.0..1.0_f64,
    ) {
        let (least, most) = hull(&movement, start);
        let bound = movement.peak_speed_from(start);
        let track = PreparedMovement::new(movement);
        for i in 0..=1000 {
            let point = track.at(start, track.duration_s() * f64::from(i) / 1000.0);
            prop_assert!(point.position >= least - 1e-9, "{point:?} {least}");
            prop_assert!(point.position <= most + 1e-9, "{point:?} {most}");
            prop_assert!(point.velocity.abs() <= bound * (1.0 + 1e-9) + 1e-12, "{point:?} {bound}");
        }
    }

    #[test]
    fn it_is_continuous_up_to_acceleration(movement in movements(), start in -1.0..1.0_f64) {
        let track = PreparedMovement::new(movement);
        let (speed, acceleration) = scales(&track, start);
        let h = 1e-4;
        let steps = (track.duration_s() / h) as usize;
        let mut before = track.at(start, 0.0);
        for i in 1..=steps {
            let point = track.at(start, i as f64 * h);
            prop_assert!((point.position - before.position).abs() <= 1.1 * h * speed + 1e-9);
            prop_assert!((point.velocity - before.velocity).abs() <= 1.1 * h * acceleration + 1e-9);
            // a fade of 0.1 s has the steepest jerk: 60/T per second, of an acceleration that goes
            // with 5.8/T²
            let jump = (point.acceleration - before.acceleration).abs();
            prop_assert!(jump <= 0.05 * acceleration + 1e-9);
            before = point;
        }
    }

    #[test]
    fn a_stop_fades_to_rest_within_the_hull(
        movement in movements(), start in -1.0..1.0_f64, part in 0.0..1.0_f64,
    ) {
        let (least, most) = hull(&movement, start);
        let track = PreparedMovement::new(movement);
        let (stopped, fade) = (part * track.duration_s(), 0.5);
        let hold = track.at(start, stopped).position;
        let at = |since: f64| stopping(track.at(start, stopped + since), hold, since, fade);
        prop_assert_eq!(at(0.0), track.at(start, stopped));
        let end = at(fade);
        prop_assert!((end.position - hold).abs() < 1e-12);
        prop_assert!(end.velocity.abs() < 1e-9 && end.acceleration.abs() < 1e-9);
        for i in 0..=100 {
            let point = at(fade * f64::from(i) / 100.0);
            prop_assert!(point.position >= least - 1e-9 && point.position <= most + 1e-9);
        }
        let h = 1e-5;
        let velocity = (at(0.2 + h).position - at(0.2 - h).position) / (2.0 * h);
        prop_assert!((velocity - at(0.2).velocity).abs() < 1e-3 * scales(&track, start).0 + 1e-5);
    }
}

fn envelope(centre: f64) -> Envelope {
    Envelope { centre, duration_s: 10.0, fade_in_s: 1.0, fade_out_s: 1.0 }
}

#[test]
fn the_full_sine_is_the_sine() {
    let track = PreparedMovement::new(Movement::GuidedSine(GuidedSine {
        line: Line { amplitude: 0.5, frequency_hz: 1.0, phase: 0.0 },
        envelope: envelope(0.1),
    }));
    let point = track.at(-0.3, 5.25);
    assert!((point.position - 0.6).abs() < 1e-12);
    assert!(point.velocity.abs() < 1e-9);
    assert!((point.acceleration + 0.5 * TAU * TAU).abs() < 1e-9);
    assert!((point.peak_speed - 0.5 * TAU).abs() < 1e-12);
    assert!((track.at(-0.3, 5.0).velocity - 0.5 * TAU).abs() < 1e-9);
}

#[test]
fn a_multisine_knows_its_peak_speed() {
    let line = |amplitude, frequency_hz| Line { amplitude, frequency_hz, phase: 0.0 };
    let movement = Movement::Multisine(Multisine {
        lines: vec![line(0.2, 1.0), line(0.1, 2.0)],
        envelope: envelope(0.0),
    });
    // both cosines are 1 at t = 0
    let peak = PreparedMovement::new(movement).at(0.0, 5.0).peak_speed;
    assert!((peak - TAU * 0.4).abs() < 1e-9, "{peak}");
}

#[test]
fn steps_rise_and_dwell() {
    let track = PreparedMovement::new(Movement::Steps(Steps {
        positions: vec![1.0, -1.0],
        dwell_s: 1.0,
        rise_s: 0.5,
    }));
    assert_eq!(track.duration_s(), 3.0);
    assert_eq!(track.at(0.0, 1.2), Point { peak_speed: 3.75, ..Point::at_rest(1.0) });
    let half = track.at(0.0, 1.75);
    assert!(half.position.abs() < 1e-12);
    // minimum jerk peaks at 15/8 of the mean speed
    assert!((half.velocity + 1.875 * 2.0 / 0.5).abs() < 1e-9);
}

#[test]
fn modes_follow_the_movement() {
    let hold = PreparedMovement::new(Movement::Hold(Hold {
        position: Some(0.5),
        rise_s: 1.0,
        duration_s: 2.0,
        resting: Mode::Hold,
    }));
    assert_eq!(hold.movement.mode(0.5), Mode::Position);
    assert_eq!(hold.movement.mode(1.5), Mode::Hold);
    assert_eq!(
        PreparedMovement::new(Movement::Rest(Rest { duration_s: 1.0 })).movement.mode(0.5),
        Mode::Passive
    );
    assert_eq!(
        PreparedMovement::new(Movement::Hold(Hold {
            position: None,
            rise_s: 0.5,
            duration_s: 1.0,
            resting: Mode::Hold,
        }))
        .movement
        .mode(0.0),
        Mode::Hold
    );
}

#[test]
fn a_ramp_goes_at_its_speed_and_a_short_one_slower() {
    let ramp =
        |position| Movement::Ramp(Ramp { position, speed: 0.5, ease_s: 0.2, duration_s: 10.0 });
    let long = PreparedMovement::new(ramp(2.0));
    for t in [0.2, 1.0, 2.0, 4.0] {
        let point = long.at(0.0, t);
        assert!(
            (point.velocity - 0.5).abs() < 1e-12
                && (point.position - 0.5 * (t - 0.1)).abs() < 1e-12,
            "{point:?}"
        );
    }
    assert_eq!(long.at(0.0, 4.2), Point::at_rest(2.0));
    let short = PreparedMovement::new(ramp(0.05));
    assert!((short.at(0.0, 0.2).velocity - 0.25).abs() < 1e-12);
    assert_eq!(short.at(0.0, 0.4), Point::at_rest(0.05));
    assert_eq!(PreparedMovement::new(ramp(0.3)).at(0.3, 1.0), Point::at_rest(0.3), "nowhere to go");
}

#[test]
fn a_chirp_passes_through_its_frequencies() {
    for (exponential, middle) in [(false, 5.25), (true, 5f64.sqrt())] {
        let chirp = Chirp {
            amplitude: 0.1,
            frequencies_hz: [0.5, 10.0],
            exponential,
            envelope: Envelope { duration_s: 20.0, ..envelope(0.0) },
        };
        for (t, hertz) in [(0.0, 0.5), (10.0, middle), (20.0, 10.0)] {
            let (_, omega, _) = chirp.phase(t);
            assert!((omega / TAU - hertz).abs() < 1e-9, "{} Hz after {t} s", omega / TAU);
        }
        let h = 1e-6;
        let slope = (chirp.phase(7.0 + h).0 - chirp.phase(7.0 - h).0) / (2.0 * h);
        assert!((slope - chirp.phase(7.0).1).abs() < 1e-4);
    }
}

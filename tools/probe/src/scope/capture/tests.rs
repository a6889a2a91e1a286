use proptest::prelude::*;

use super::*;

/// 1 kHz.
const PERIOD_NS: u64 = 1_000_000;

fn settings(mode: Mode) -> Settings {
    Settings {
        mode,
        window_ns: 10 * PERIOD_NS,
        pre_ns: 4 * PERIOD_NS,
        auto_ns: 50 * PERIOD_NS,
        channel: (0, 0),
        condition: Condition::Rising(1.0),
        hysteresis: 0.0,
    }
}

/// 0, and 1 from each of these samples on, for three samples.
fn pulses(at: u64, begins: &[u64]) -> f64 {
    f64::from(u8::from(begins.iter().any(|begin| (*begin..begin + 3).contains(&at))))
}

/// Feeds samples of one channel; the windows.
fn run(capturer: &mut Capturer, samples: impl Iterator<Item = (u64, f64)>) -> Vec<Capture> {
    let mut captures = Vec::new();
    for (at, value) in samples {
        capturer.take(0, at * PERIOD_NS, None, &[value]);
        captures.extend(capturer.advance(at * PERIOD_NS));
    }
    captures
}

fn values(capture: &Capture) -> Vec<f64> {
    capture.rows[0].points(0).map(|point| point.value).collect()
}

#[test]
fn each_trigger_gives_a_window_with_what_was_before_it() {
    let mut capturer = Capturer::new(settings(Mode::Normal), &[1], 64);
    let begins = [20, 24, 50];
    let captures = run(&mut capturer, (0..100).map(|at| (at, pulses(at, &begins))));
    // The one at 24 is within the first window.
    let zeros: Vec<_> = captures.iter().map(|capture| capture.zero_ns / PERIOD_NS).collect();
    assert_eq!(zeros, [20, 50]);
    let first = &captures[0];
    assert_eq!((first.begin_ns, first.end_ns), (16 * PERIOD_NS, 26 * PERIOD_NS));
    assert_eq!(values(first), [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 1.0, 1.0, 1.0]);
    assert!(first.triggered && first.whole && !first.overwritten && first.lost() == 0);
}

#[test]
fn the_time_before_the_trigger_goes_across_the_end_of_the_ring() {
    // The ring begins anew within the window, wherever that lies.
    for trigger in 20..40 {
        let mut capturer = Capturer::new(settings(Mode::Single), &[1], 11);
        let captures = run(
            &mut capturer,
            (0..100).map(|at| (at, if at < trigger { -1.0 } else { at as f64 })),
        );
        assert_eq!(captures.len(), 1, "{trigger}");
        let expected: Vec<_> = (trigger - 4..=trigger + 6)
            .map(|at| if at < trigger { -1.0 } else { at as f64 })
            .collect();
        assert_eq!(values(&captures[0]), expected, "{trigger}");
        assert!(!captures[0].overwritten, "{trigger}");
    }
    // One row less, and its beginning is missing: that is told.
    let mut capturer = Capturer::new(settings(Mode::Single), &[1], 10);
    let captures = run(&mut capturer, (0..100).map(|at| (at, pulses(at, &[30]))));
    assert!(captures[0].overwritten);
    assert_eq!(captures[0].rows[0].len(), 10);
}

#[test]
fn single_ends_after_one_window_until_it_is_armed_anew() {
    let mut capturer = Capturer::new(settings(Mode::Single), &[1], 64);
    let begins = [20, 50, 80];
    let signal = |range: std::ops::Range<u64>| range.map(move |at| (at, pulses(at, &begins)));
    assert_eq!(run(&mut capturer, signal(0..60)).len(), 1);
    assert_eq!(capturer.doing(), "captured");
    capturer.rearm();
    let captures = run(&mut capturer, signal(60..100));
    assert_eq!(captures.len(), 1);
    assert_eq!(captures[0].zero_ns, 80 * PERIOD_NS);
}

#[test]
fn auto_captures_after_its_time_and_a_trigger_comes_first() {
    let mut capturer = Capturer::new(settings(Mode::Auto), &[1], 64);
    let captures = run(&mut capturer, (0..130).map(|at| (at, pulses(at, &[80]))));
    let found: Vec<_> = captures.iter().map(|c| (c.zero_ns / PERIOD_NS, c.triggered)).collect();
    // At 50 without a trigger: the window ends there. At 86 that of the trigger is full, and 50
    // samples later there would be another one.
    assert_eq!(found, [(44, false), (80, true)]);
    assert_eq!(captures[0].end_ns, 50 * PERIOD_NS);
    let mut normal = Capturer::new(settings(Mode::Normal), &[1], 64);
    assert!(run(&mut normal, (0..500).map(|at| (at, 0.0))).is_empty());
}

#[test]
fn a_trigger_needs_the_time_before_it() {
    let mut capturer = Capturer::new(settings(Mode::Normal), &[1], 64);
    // The first one comes three samples after the beginning; four lie before a trigger.
    let captures = run(&mut capturer, (10..60).map(|at| (at, pulses(at, &[13, 30]))));
    let zeros: Vec<_> = captures.iter().map(|capture| capture.zero_ns / PERIOD_NS).collect();
    assert_eq!((zeros, capturer.early()), (vec![30], 1));
    let mut capturer = Capturer::new(settings(Mode::Normal), &[1], 64);
    let captures = run(&mut capturer, (10..60).map(|at| (at, pulses(at, &[14, 40]))));
    assert_eq!((captures[0].zero_ns, capturer.early()), (14 * PERIOD_NS, 0));
    assert_eq!(captures[0].rows[0].len(), 11);
}

#[test]
fn a_gap_within_the_window_stays_a_gap() {
    let mut capturer = Capturer::new(settings(Mode::Normal), &[1], 64);
    let mut captures = Vec::new();
    for at in (0..40u64).filter(|at| !(22..25).contains(at)) {
        let gap = (at == 25).then_some(3);
        capturer.take(0, at * PERIOD_NS, gap, &[pulses(at, &[20])]);
        captures.extend(capturer.advance(at * PERIOD_NS));
    }
    assert_eq!(captures.len(), 1);
    let gaps: Vec<_> = captures[0].rows[0].points(0).map(|point| point.gap).collect();
    let mut expected = vec![None; 8];
    expected[6] = Some(3);
    assert_eq!((gaps, captures[0].lost()), (expected, 3));
    // An edge that lies within a gap is none.
    let mut capturer = Capturer::new(settings(Mode::Normal), &[1], 64);
    capturer.take(0, PERIOD_NS, None, &[0.0]);
    capturer.take(0, 9 * PERIOD_NS, Some(7), &[5.0]);
    assert_eq!(capturer.advance(10_000 * PERIOD_NS), None);
}

#[test]
fn a_window_waits_for_the_topics_that_are_behind() {
    let mut capturer = Capturer::new(settings(Mode::Normal), &[1, 2], 64);
    for at in 0..40 {
        capturer.take(0, at * PERIOD_NS, None, &[pulses(at, &[20])]);
    }
    assert_eq!(capturer.advance(39 * PERIOD_NS), None, "the other topic has no sample yet");
    for at in 0..20 {
        capturer.take(1, 2 * at * PERIOD_NS, None, &[at as f64, 0.5]);
    }
    let capture = capturer.advance(39 * PERIOD_NS).unwrap();
    assert_eq!(values(&capture).len(), 11);
    let slow: Vec<_> = capture.rows[1].points(0).map(|point| point.value).collect();
    assert_eq!(slow, [8.0, 9.0, 10.0, 11.0, 12.0, 13.0]);
    assert!(capture.rows[1].points(1).all(|point| point.value == 0.5));
    // One that publishes nothing is not waited for longer than half a second.
    capturer.take(0, 100 * PERIOD_NS, None, &[1.0]);
    assert_eq!(capturer.advance(605 * PERIOD_NS), None);
    let capture = capturer.advance(606 * PERIOD_NS).unwrap();
    assert_eq!((capture.zero_ns, capture.rows[1].len()), (100 * PERIOD_NS, 0));
}

#[test]
fn the_end_of_a_recording_cuts_a_window_short() {
    let mut capturer = Capturer::new(settings(Mode::Normal), &[1], 64);
    assert!(run(&mut capturer, (0..23).map(|at| (at, pulses(at, &[20])))).is_empty());
    let capture = capturer.finish().unwrap();
    assert!(capture.triggered && !capture.whole);
    assert_eq!(values(&capture), [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0]);
    assert_eq!(capturer.finish(), None);
}

#[test]
fn rolling_shows_the_newest_and_never_triggers() {
    let mut capturer = Capturer::new(settings(Mode::Roll), &[1], 64);
    assert!(run(&mut capturer, (0..60).map(|at| (at, pulses(at, &[20, 40])))).is_empty());
    let newest = capturer.newest();
    assert_eq!((newest.begin_ns, newest.end_ns), (49 * PERIOD_NS, 59 * PERIOD_NS));
    assert!(!newest.triggered && newest.rows[0].len() == 11);
}

proptest! {
    /// Whatever the signal, the losses and the settings: a window has the sample that triggered,
    /// at its place, which is above the level, and whole the samples that came in its time.
    #[test]
    fn a_window_has_its_trigger_where_it_belongs(
        values in prop::collection::vec(-1.0..1.0f64, 1..400),
        lost in prop::collection::vec(0..8u8, 400),
        level in -0.5..0.5f64,
        hysteresis in 0.0..0.3f64,
        window in 1..60u64,
        share in 0.0..=1.0f64,
        single in any::<bool>(),
    ) {
        let pre = (share * window as f64) as u64;
        let settings = Settings {
            mode: if single { Mode::Single } else { Mode::Normal },
            window_ns: window * PERIOD_NS,
            pre_ns: pre * PERIOD_NS,
            condition: Condition::Rising(level),
            hysteresis,
            ..settings(Mode::Normal)
        };
        let mut capturer = Capturer::new(settings, &[1], 64);
        let mut fed: Vec<(u64, f64)> = Vec::new();
        let mut captures = Vec::new();
        let mut missing = 0;
        for (at, value) in (1u64..).zip(values) {
            // One sample in eight does not come.
            if lost[at as usize - 1] == 0 {
                missing += 1;
                continue;
            }
            let gap = (missing > 0).then_some(std::mem::take(&mut missing));
            capturer.take(0, at * PERIOD_NS, gap, &[value]);
            fed.push((at * PERIOD_NS, value));
            captures.extend(capturer.advance(at * PERIOD_NS));
        }
        captures.extend(capturer.finish());
        prop_assert!(!single || captures.len() <= 1);
        let mut ended = 0;
        for capture in &captures {
            prop_assert!(capture.triggered);
            prop_assert!(capture.zero_ns > ended || ended == 0, "windows overlap");
            prop_assert_eq!(capture.end_ns, capture.zero_ns + (window - pre) * PERIOD_NS);
            prop_assert_eq!(
                capture.begin_ns,
                capture.zero_ns.saturating_sub(pre * PERIOD_NS)
            );
            let points: Vec<_> =
                capture.rows[0].points(0).map(|point| (point.time_ns, point.value)).collect();
            let at_zero = points.iter().find(|(time_ns, _)| *time_ns == capture.zero_ns);
            prop_assert!(at_zero.is_some_and(|(_, value)| *value >= level));
            let inside = |(time_ns, _): &&(u64, f64)| {
                (capture.begin_ns..=capture.end_ns).contains(time_ns)
            };
            let expected: Vec<_> = fed.iter().filter(inside).copied().collect();
            prop_assert_eq!(points, expected);
            ended = capture.end_ns;
        }
    }
}

//! Sessions: sums, targets, bars and rests, as functions of samples and segments alone.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use experiment::matching_bar::{Effort, HIGHEST, Matched, height};
use experiment::session_state::{SessionState, SessionStep};
use experiment::session_tracker::{PlayedSegment, SessionPlan, SessionReport, SessionTracker};
use ipc_types::{ANALOG, Light, Performance, SessionOutcome, SessionResult};
use proptest::prelude::*;
use rig::protocol::Signal;

const MS: u64 = 1_000_000;
const SECOND: u64 = 1_000 * MS;
const BEGIN: u64 = 7 * SECOND + 123_456;

/// A protocol on a time axis: kinds of segments with their durations (s).
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Wait,
    Session,
    Centring,
    Rest,
}
use Kind::{Centring, Rest, Session, Wait};

struct Played {
    performance: Vec<Performance>,
    results: Vec<SessionResult>,
    started: Vec<u32>,
    state: SessionState,
}

fn segments(list: &[(Kind, f64)]) -> Vec<PlayedSegment> {
    let (mut begun_ns, mut session) = (BEGIN, 0);
    list.iter()
        .enumerate()
        .map(|(at, (kind, planned_s))| {
            session += u32::from(*kind == Session);
            let segment = PlayedSegment {
                segment: at as u32,
                begun_ns,
                planned_s: *planned_s,
                session: (*kind == Session).then_some(session),
                rest: *kind == Rest,
                contraction: 0,
            };
            begun_ns += (planned_s * 1e9) as u64;
            segment
        })
        .collect()
}

/// Plays segments with samples at 2 kHz; `cycle_ns` is the period at which the loop runs, and so
/// how late samples arrive.
fn play(
    signal: Option<Signal>,
    list: &[(Kind, f64)],
    cycle_ns: u64,
    effort: impl Fn(f64) -> (f64, [f64; 2]),
) -> Played {
    let segments = segments(list);
    let plan = SessionPlan {
        sessions: segments.iter().filter(|segment| segment.session.is_some()).count() as u32,
        matched: signal.map(|signal| Matched { signal, axis: 0 }),
    };
    let mut tracker = SessionTracker::new(2000.0);
    tracker.begin(1, plan, None);
    let end_ns =
        segments.last().map_or(BEGIN, |last| last.begun_ns + (last.planned_s * 1e9) as u64);
    let mut played = Played {
        performance: Vec::new(),
        results: Vec::new(),
        started: Vec::new(),
        state: SessionState::default(),
    };
    let (mut at, mut tick, mut now_ns, mut next_ns) = (0, 0, BEGIN, BEGIN + 100_000);
    loop {
        // The player's step, and then the samples that came by then.
        while at < segments.len() && segments[at].begun_ns <= now_ns {
            tracker.pass_edge(segments[at].begun_ns, SessionOutcome::Whole, Some(segments[at]));
            at += 1;
        }
        if now_ns >= end_ns && at == segments.len() {
            tracker.pass_edge(end_ns, SessionOutcome::Whole, None);
            at += 1;
        }
        while next_ns <= now_ns {
            let (torque, activity) = effort((next_ns - BEGIN) as f64 * 1e-9);
            let torque = [torque, 0.0, 0.0];
            let none = Effort::default();
            tracker.see(Effort { at_ns: next_ns, tick, torque, activity, ..none });
            (tick, next_ns) = (tick + 1, next_ns + SECOND / 2000);
        }
        tracker.advance(now_ns);
        while let Some(report) = tracker.take_report() {
            match report {
                SessionReport::Performance(message) => played.performance.push(message),
                SessionReport::Started(number, _) => played.started.push(number),
                SessionReport::Ended(result) => played.results.push(result),
                SessionReport::Contracted(_) => panic!("none was measured"),
                SessionReport::Step(_, step) => played.state.take(step),
            }
        }
        if now_ns > end_ns + SECOND {
            assert_eq!(tracker.dropped(), 0);
            assert_eq!(&played.state, tracker.state(), "the steps make the same state");
            return played;
        }
        now_ns += cycle_ns;
    }
}

const MATCHING: &[(Kind, f64)] = &[
    (Wait, 2.0),
    (Session, 6.0),
    (Centring, 3.0),
    (Rest, 10.0),
    (Session, 6.0),
    (Centring, 3.0),
    (Rest, 4.0),
    (Session, 6.0),
    (Centring, 3.0),
];

/// 0.2 N·m, to and fro, and twice as much from 15 s on: in the second and third session.
fn torque(t: f64) -> (f64, [f64; 2]) {
    let magnitude = if t < 15.0 { 0.2 } else { 0.4 };
    let up = ((t * 2.0) as u64).is_multiple_of(2);
    (if up { magnitude } else { -magnitude }, [0.0; 2])
}

fn close(found: f64, expected: f64) {
    assert!((found - expected).abs() < 1e-9, "{found} instead of {expected}");
}

#[test]
fn each_session_has_to_match_the_one_before() {
    let played = play(Some(Signal::Torque), MATCHING, 2 * MS, torque);
    assert_eq!(played.started, [1, 2, 3]);
    let [first, second, third] = played.results[..] else { panic!("{:?}", played.results) };
    for (result, value, target) in [(first, 0.2, 0.0), (second, 0.4, 0.2), (third, 0.4, 0.4)] {
        close(result.value[0], value);
        close(result.target[0], target);
        assert_eq!((result.samples, result.samples_missed), (12_000, 0));
        assert_eq!(result.ended_ns - result.begun_ns, 6 * SECOND);
        assert_eq!(result.outcome, SessionOutcome::Whole.code());
        close(result.torque_sum[0], value * 12_000.0);
    }
    assert_eq!([first.number, second.number, third.number], [1, 2, 3]);
    assert_eq!(first.sessions, 3);
    // Nothing to be seen in the first; twice the effort is the cap in the second, and the same
    // effort the middle in the third.
    let shown = |number: u32| {
        let of = |p: &&Performance| p.number == number && p.light == Light::Green.code();
        played.performance.iter().filter(of).map(|p| (p.bars, p.height[0])).collect::<Vec<_>>()
    };
    assert!(shown(1).iter().all(|shown| *shown == (0, 0.0)));
    assert_eq!(*shown(2).last().unwrap(), (1, HIGHEST));
    let last = *shown(3).last().unwrap();
    assert_eq!(last.0, 1);
    close(last.1, 10.0);
    // 50 a second, each at its place on the grid.
    assert_eq!(shown(2).len(), 300);
    for message in &played.performance {
        assert_eq!((message.at_ns - message.begun_ns) % (20 * MS), 0);
    }
}

#[test]
fn a_bar_is_updated_once_a_second_with_the_mean_so_far() {
    let played = play(Some(Signal::Torque), MATCHING, 2 * MS, |t| (t * 0.01, [0.0; 2]));
    let of = |p: &&Performance| p.number == 2 && p.light == Light::Green.code();
    let updates: Vec<_> = played.performance.iter().filter(of).collect();
    assert_eq!((updates[0].update, updates[0].height[0], updates[0].bars), (0, 0.0, 1));
    for update in 1..=6u32 {
        // Ramp from the beginning of session 2, 21 s after the protocol's: the mean of the samples.
        let samples = 2000 * update;
        let mean = (0..samples).map(|k| 21.0 + 1e-4 + f64::from(k) * 5e-4).sum::<f64>()
            / f64::from(samples)
            * 0.01;
        let first = updates.iter().find(|p| p.update == update).unwrap();
        assert_eq!(first.at_ns - first.begun_ns, u64::from(update) * SECOND);
        assert!((first.value[0] - mean).abs() < 1e-9, "{} {mean}", first.value[0]);
        close(first.height[0], height(mean, first.target[0]));
    }
}

#[test]
fn a_rest_repeats_the_bar_of_its_session_and_then_shows_none() {
    let played = play(Some(Signal::Torque), MATCHING, 2 * MS, torque);
    let rest = |segment: u32| {
        let of = |p: &&Performance| p.segment == segment;
        played.performance.iter().filter(of).collect::<Vec<_>>()
    };
    let first = rest(3);
    assert_eq!(first.len(), 501, "from the beginning to the end of 10 s");
    for message in &first {
        let second = (message.at_ns - message.begun_ns) / SECOND;
        let shown = u8::from(second < 6);
        assert_eq!((message.bars, message.replay), (shown, shown), "{message:?}");
        assert_eq!(message.light, Light::Red.code());
        // The first session had no target: its own mean is the middle.
        close(message.height[0], 10.0 * f64::from(shown));
        assert_eq!(message.update, if shown == 1 { second as u32 + 1 } else { 0 });
    }
    // The second one's bar as it was seen.
    assert!(rest(6).iter().all(|p| p.replay == 1 && p.height[0] == HIGHEST && p.target[0] < 0.21));
    // While the handle is centred, the bar stays.
    let centring: Vec<_> = played.performance.iter().filter(|p| p.segment == 5).collect();
    assert!(centring.iter().all(|p| (p.bars, p.height[0], p.replay) == (1, HIGHEST, 0)));
    // At the end there is none.
    let last = played.performance.last().unwrap();
    assert_eq!((last.bars, last.light), (0, Light::Red.code()));
}

#[test]
fn muscles_have_a_bar_each_over_the_last_three_half_seconds() {
    // The agonist rises in steps of half a second in each session, the antagonist is constant.
    let in_session = |t: f64| [2.0, 21.0, 34.0].iter().rev().find(|b| t >= **b).map(|b| t - b);
    let activity = |t: f64| {
        let step = in_session(t).map_or(0.0, |since| (since / 0.5).floor().min(11.0));
        (0.0, [step, 3.0])
    };
    let played = play(Some(Signal::Emg), MATCHING, 2 * MS, activity);
    close(played.results[0].value[0], 5.5);
    close(played.results[0].value[1], 3.0);
    let of = |p: &&Performance| p.number == 2 && p.light == Light::Green.code();
    let session: Vec<_> = played.performance.iter().filter(of).collect();
    for update in 1..=12u32 {
        let message = session.iter().find(|p| p.update == update).unwrap();
        assert_eq!((message.at_ns - message.begun_ns) / MS, u64::from(update) * 500);
        let newest = f64::from(update - 1);
        let mean = match update {
            1 => newest,
            2 => newest - 0.5,
            _ => newest - 1.0,
        };
        close(message.value[0], mean);
        close(message.height[0], height(mean, 5.5));
        close(message.height[1], 10.0);
        assert_eq!(message.bars, 2);
    }
    // The rest repeats both, twice a second.
    let rest: Vec<_> = played.performance.iter().filter(|p| p.segment == 6).collect();
    assert_eq!(rest[0].update, 1);
    assert_eq!(rest.last().unwrap().update, 9, "4 s of the session's 6");
    close(rest[0].height[0], 0.0);
    close(rest.last().unwrap().value[0], 7.0);
}

#[test]
fn sessions_that_match_nothing_have_sums_and_no_bar() {
    let played = play(None, &[(Session, 5.0), (Rest, 1.0), (Session, 5.02)], 2 * MS, torque);
    assert_eq!(played.results.len(), 2);
    close(played.results[0].torque_sum[0], 2000.0);
    assert_eq!(played.results[1].samples, 10_040);
    assert!(played.performance.iter().all(|p| p.bars == 0 && p.update == 0));
    assert!(played.results.iter().all(|result| result.value == [0.0; 2]));
}

#[test]
fn an_interrupted_session_is_counted_again_and_a_stopped_one_gives_no_target() {
    let plan =
        SessionPlan { sessions: 2, matched: Some(Matched { signal: Signal::Torque, axis: 0 }) };
    let mut tracker = SessionTracker::new(2000.0);
    tracker.begin(1, plan, None);
    let session = |begun_ns| PlayedSegment {
        segment: 0,
        begun_ns,
        planned_s: 5.0,
        session: Some(1),
        rest: false,
        contraction: 0,
    };
    tracker.pass_edge(0, SessionOutcome::Whole, Some(session(0)));
    let sample = |k: u64| Effort {
        at_ns: k * SECOND / 2000,
        tick: k,
        torque: [1.0, 0.0, 0.0],
        ..Effort::default()
    };
    (0..3000).for_each(|k| tracker.see(sample(k)));
    // No samples for a second: the player begins the segment anew. Of the samples that come then,
    // those from before its beginning belong to the interrupted session.
    let again = 5 * SECOND / 2;
    tracker.pass_edge(again, SessionOutcome::Interrupted, Some(session(again)));
    (4990..5600).for_each(|k| tracker.see(sample(k)));
    let mut results = Vec::new();
    let mut drain = |tracker: &mut SessionTracker, now_ns| {
        for _ in 0..1000 {
            tracker.advance(now_ns);
            while let Some(report) = tracker.take_report() {
                if let SessionReport::Ended(result) = report {
                    results.push(result);
                }
            }
        }
    };
    drain(&mut tracker, 2_800 * MS);
    tracker.pass_edge(2_810 * MS, SessionOutcome::Stopped, None);
    // Without a sample after it, an edge counts after a while.
    drain(&mut tracker, 2_811 * MS);
    drain(&mut tracker, 2_950 * MS);
    let found: Vec<_> = results.iter().map(|r| (r.outcome, r.samples, r.samples_missed)).collect();
    let (interrupted, stopped) =
        (SessionOutcome::Interrupted.code(), SessionOutcome::Stopped.code());
    assert_eq!(found, [(interrupted, 3010, 1990), (stopped, 600, 20)]);
    assert!(!tracker.state().has_target());
}

#[test]
fn a_protocol_that_is_resumed_keeps_target_and_values() {
    let mut state = SessionState::default();
    for step in [
        SessionStep::Begun,
        SessionStep::Update([0.3, 0.0]),
        SessionStep::Update([0.1, 0.0]),
        SessionStep::Over(1, [0.2, 0.0]),
    ] {
        state.take(step);
    }
    let plan =
        SessionPlan { sessions: 4, matched: Some(Matched { signal: Signal::Torque, axis: 0 }) };
    let mut tracker = SessionTracker::new(2000.0);
    tracker.begin(1, plan, Some(&state));
    let rest = PlayedSegment {
        segment: 3,
        begun_ns: SECOND,
        planned_s: 9.0,
        session: None,
        rest: true,
        contraction: 0,
    };
    tracker.pass_edge(SECOND, SessionOutcome::Interrupted, Some(rest));
    for k in 0..4000 {
        let at_ns = SECOND + k * SECOND / 2000;
        tracker.see(Effort { at_ns, tick: k, ..Effort::default() });
    }
    let mut heights = Vec::new();
    for _ in 0..100 {
        tracker.advance(4 * SECOND);
        while let Some(report) = tracker.take_report() {
            if let SessionReport::Performance(message) = report {
                assert_eq!(message.number, 1);
                heights.push((message.update, message.height[0]));
            }
        }
    }
    heights.dedup();
    assert_eq!(heights, [(1, height(0.3, 0.2)), (2, height(0.1, 0.2))]);
}

#[test]
fn a_session_that_the_scanners_clock_ends_early_has_its_last_update() {
    let plan =
        SessionPlan { sessions: 1, matched: Some(Matched { signal: Signal::Torque, axis: 0 }) };
    let mut tracker = SessionTracker::new(2000.0);
    tracker.begin(1, plan, None);
    let session = PlayedSegment {
        segment: 0,
        begun_ns: 0,
        planned_s: 5.0,
        session: Some(1),
        rest: false,
        contraction: 0,
    };
    let centring = PlayedSegment {
        segment: 1,
        begun_ns: 4_998 * MS,
        planned_s: 3.0,
        session: None,
        rest: false,
        contraction: 0,
    };
    tracker.pass_edge(0, SessionOutcome::Whole, Some(session));
    tracker.pass_edge(4_998 * MS, SessionOutcome::Whole, Some(centring));
    let mut shown = Vec::new();
    for k in 0..10_100u64 {
        let at_ns = k * SECOND / 2000;
        let torque = [at_ns as f64 * 1e-9, 0.0, 0.0];
        tracker.see(Effort { at_ns, tick: k, torque, ..Effort::default() });
        tracker.advance(at_ns);
        while let Some(report) = tracker.take_report() {
            if let SessionReport::Performance(message) = report
                && message.segment == 0
            {
                shown.push(message);
            }
        }
    }
    let last = shown.last().unwrap();
    assert_eq!((last.at_ns, last.update, last.samples), (4_998 * MS, 5, 9_996));
    close(last.value[0], 0.5 * 9_995.0 / 2000.0);
    assert_eq!(tracker.state().values.len(), 5);
    // One that ends when it was planned reports each instant once.
    assert_eq!(shown.len(), 250);
}

#[test]
fn a_contraction_has_the_maxima_of_its_own_samples() {
    let mut tracker = SessionTracker::new(2000.0);
    tracker.begin(1, SessionPlan { sessions: 2, matched: None }, None);
    let contraction = |number: u32| PlayedSegment {
        segment: number - 1,
        begun_ns: u64::from(number - 1) * 2 * SECOND,
        planned_s: 2.0,
        session: Some(number),
        rest: false,
        contraction: 0b101,
    };
    tracker.pass_edge(0, SessionOutcome::Whole, Some(contraction(1)));
    tracker.pass_edge(2 * SECOND, SessionOutcome::Whole, Some(contraction(2)));
    tracker.pass_edge(4 * SECOND, SessionOutcome::Stopped, None);
    let mut found = Vec::new();
    for k in 0..8_400u64 {
        let at_ns = k * SECOND / 2000;
        let mut rectified = [f64::NAN; ANALOG];
        // Half a second of 3 in the first contraction; 9 begins with the first sample after it.
        rectified[0] = match k {
            1000..2000 => 3.0,
            4000.. => 9.0,
            _ => 1.0,
        };
        rectified[1] = 7.0;
        rectified[2] = if k < 4000 { k as f64 } else { 0.0 };
        tracker.see(Effort { at_ns, tick: k, rectified, ..Effort::default() });
        tracker.advance(at_ns);
        while let Some(report) = tracker.take_report() {
            if let SessionReport::Contracted(maximum) = report {
                found.push(maximum);
            }
        }
    }
    let [first] = found[..] else { panic!("{found:?}: a contraction that is stopped counts not") };
    assert_eq!((first.number, first.inputs, first.used), (1, 0b101, 0));
    assert_eq!((first.begun_ns, first.ended_ns), (0, 2 * SECOND));
    close(first.maximum[0], 3.0);
    assert_eq!(first.maximum[1], 0.0, "it was not measured");
    // The mean of the last thousand samples of the session.
    close(first.maximum[2], 3499.5);
    assert_eq!(tracker.state().maxima, first.maximum);
    let mut state = tracker.state().clone();
    state.take(SessionStep::Contracted([3.1; ANALOG]));
    assert_eq!((state.maxima[0], state.maxima[2]), (3.1, first.maximum[2]), "the larger counts");
}

proptest! {
    /// However late the loop runs, and so in whatever groups the samples come, the messages are the
    /// same.
    #[test]
    fn messages_do_not_depend_on_when_the_loop_runs(cycles in 1u64..40) {
        let list = &[(Wait, 0.5), (Session, 5.0), (Centring, 0.3), (Rest, 1.5), (Session, 5.0)];
        let wave = |t: f64| ((t * 3.0).sin(), [t.cos().abs(), 0.5]);
        let usual = play(Some(Signal::Torque), list, 2 * MS, wave);
        let late = play(Some(Signal::Torque), list, cycles * 2 * MS, wave);
        prop_assert_eq!(usual.performance, late.performance);
        prop_assert_eq!(usual.results, late.results);
    }

    /// The bar lies between 0 and its cap, and rises with the value.
    #[test]
    fn heights_are_bounded_and_monotonic(
        value in 0.0f64..1e6,
        more in 0.0f64..1e6,
        target in 0.0f64..1e6,
    ) {
        let (lower, higher) = (height(value, target), height(value + more, target));
        prop_assert!((0.0..=HIGHEST).contains(&lower) && lower <= higher && higher <= HIGHEST);
    }
}

//! Samples that are missing, protocols that follow each other, and one that ends at its resumption.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use experiment::matching_bar::Effort;
use experiment::session_state::{SessionState, SessionStep};
use experiment::session_tracker::{PlayedSegment, SessionPlan, SessionReport, SessionTracker};
use ipc_types::{Light, SessionOutcome, SessionResult};

const SECOND: u64 = 1_000_000_000;

/// A tracker in a session of 5 s from 1 s on, after a centring.
fn in_session(run: u32, tracker: &mut SessionTracker, begun_ns: u64) {
    let plan = SessionPlan { sessions: 1, matched: None };
    tracker.begin(run, plan, None);
    let segment = |segment, begun_ns, session| PlayedSegment {
        segment,
        begun_ns,
        planned_s: 5.0,
        session,
        rest: false,
        contraction: 0,
    };
    tracker.pass_edge(begun_ns - SECOND, SessionOutcome::Whole, Some(segment(0, begun_ns, None)));
    tracker.pass_edge(begun_ns, SessionOutcome::Whole, Some(segment(1, begun_ns, Some(1))));
}

/// The results after these ticks at 2 kHz, and an end at `ended_ns`.
fn results(
    tracker: &mut SessionTracker,
    ticks: impl Iterator<Item = u64>,
    ended_ns: u64,
) -> Vec<SessionResult> {
    tracker.pass_edge(ended_ns, SessionOutcome::Whole, None);
    let mut found = Vec::new();
    let mut take = |tracker: &mut SessionTracker, now_ns: u64| {
        tracker.advance(now_ns);
        while let Some(report) = tracker.take_report() {
            if let SessionReport::Ended(result) = report {
                found.push(result);
            }
        }
    };
    for tick in ticks {
        let at_ns = tick * SECOND / 2000;
        tracker.see(Effort { at_ns, tick, ..Effort::default() });
        take(tracker, at_ns);
    }
    take(tracker, ended_ns + SECOND);
    found
}

#[test]
fn samples_that_are_missing_count_in_their_session_alone() {
    // Sessions from tick 2000 to 12000.
    for (left_out, expected) in [
        (0..0, 0),
        (3000..3010, 10),
        // Across its beginning, and across its end.
        (1990..2005, 5),
        (11_990..12_010, 10),
        // No sample comes after the last that is there.
        (11_000..14_000, 1000),
        (1990..14_000, 10_000),
    ] {
        let mut tracker = SessionTracker::new(2000.0);
        in_session(1, &mut tracker, SECOND);
        let ticks = (500..14_000u64).filter(|tick| !left_out.contains(tick));
        let [result] = results(&mut tracker, ticks, 6 * SECOND)[..] else { panic!() };
        let counted = (result.samples_missed, result.samples);
        assert_eq!(counted, (expected, 10_000 - expected), "{left_out:?}");
    }
}

#[test]
fn a_second_protocol_knows_nothing_of_the_first() {
    let mut tracker = SessionTracker::new(2000.0);
    in_session(1, &mut tracker, SECOND);
    assert_eq!(results(&mut tracker, 500..13_000, 6 * SECOND)[0].samples_missed, 0);
    // Half an hour later; it begins with a session.
    let begun_ns = 1800 * SECOND;
    in_session(2, &mut tracker, begun_ns);
    let first = 1800 * 2000;
    let second = results(&mut tracker, first..first + 11_000, begun_ns + 5 * SECOND);
    assert_eq!((second[0].samples_missed, second[0].samples), (0, 10_000));
    // One that is begun at once leaves the end of the one before to be reported, as its own.
    in_session(3, &mut tracker, 2000 * SECOND);
    let ticks = 2000 * 2000..2005 * 2000u64;
    for tick in ticks {
        let at_ns = tick * SECOND / 2000;
        tracker.see(Effort { at_ns, tick, ..Effort::default() });
        tracker.advance(at_ns);
        while tracker.take_report().is_some() {}
    }
    tracker.pass_edge(2005 * SECOND, SessionOutcome::Whole, None);
    tracker.begin(4, SessionPlan { sessions: 1, matched: None }, None);
    let mut runs = Vec::new();
    while let Some(report) = tracker.take_report() {
        if let SessionReport::Step(run, SessionStep::Over(number, _)) = report {
            runs.push((run, number));
        }
    }
    assert_eq!(runs, [(3, 1)]);
    assert_eq!((tracker.dropped(), tracker.state().over), (0, 0));
}

#[test]
fn a_resumed_protocol_that_ends_before_it_goes_on_turns_the_light_red() {
    let mut tracker = SessionTracker::new(2000.0);
    tracker.begin(1, SessionPlan { sessions: 2, matched: None }, Some(&SessionState::default()));
    tracker.pass_edge(SECOND, SessionOutcome::Stopped, None);
    tracker.advance(2 * SECOND);
    let Some(SessionReport::Performance(last)) = tracker.take_report() else { panic!() };
    assert_eq!((last.light, last.bars), (Light::Red.code(), 0));
}

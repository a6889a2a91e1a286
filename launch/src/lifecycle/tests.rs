use super::*;
use crate::units::SchedulingPolicy;

const MS: Duration = Duration::from_millis(1);

/// Longer than every test: a watchdog that is not watched.
const UNWATCHED: Duration = Duration::from_secs(1_000_000);

fn unit(name: &str, after: &[&str], gates: &[&str], watchdog: Duration) -> Unit {
    let names = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect();
    Unit {
        name: name.to_owned(),
        after: names(after),
        gates: names(gates),
        timeout_start: 100 * MS,
        timeout_stop: 30 * MS,
        watchdog,
        scheduling: SchedulingPolicy::Other,
        limit_rtprio: None,
        locks_memory: false,
        oom_score_adjust: None,
    }
}

/// keeper <- control (gated by keeper) <- watchdog (gated by keeper, after control).
fn lifecycle() -> Lifecycle {
    let mut lifecycle = Lifecycle::new(&[
        unit("keeper", &[], &[], UNWATCHED),
        unit("control", &["keeper"], &["keeper"], 20 * MS),
        unit("watchdog", &["keeper", "control"], &["keeper"], UNWATCHED),
    ]);
    lifecycle.start_limit = usize::MAX;
    lifecycle
}

const KEEPER: usize = 0;
const CONTROL: usize = 1;
const WATCHDOG: usize = 2;

fn up() -> Lifecycle {
    let mut lifecycle = lifecycle();
    for unit in [KEEPER, CONTROL, WATCHDOG] {
        assert_eq!(lifecycle.tick(Duration::ZERO), [Action::Start(unit)]);
        assert_eq!(lifecycle.phase(), RigState::Starting);
        lifecycle.ready(unit, Duration::ZERO);
    }
    assert_eq!(lifecycle.tick(Duration::ZERO), []);
    assert_eq!(lifecycle.phase(), RigState::Up);
    lifecycle
}

#[test]
fn a_crash_is_followed_by_growing_pauses_up_to_the_cap() {
    let mut lifecycle = up();
    let mut now = 5 * MS;
    let mut pauses = Vec::new();
    for _ in 0..9 {
        lifecycle.exited(CONTROL, Exit::Signal(9), now);
        assert_eq!(lifecycle.tick(now), []);
        let due = lifecycle.next_deadline().unwrap();
        assert_eq!(lifecycle.tick(due - MS), []);
        assert_eq!(lifecycle.tick(due), [Action::Start(CONTROL)]);
        pauses.push((due - now).as_millis());
        lifecycle.ready(CONTROL, due);
        now = due + MS;
    }
    assert_eq!(pauses, [50, 100, 200, 400, 800, 1600, 2000, 2000, 2000]);
    assert_eq!(lifecycle.restarts(CONTROL), 9);
    // Ready for long enough: the next restart comes at once again.
    let mut pinged = now;
    while pinged < now + HEALTHY_AFTER {
        lifecycle.ping(CONTROL, false, pinged);
        pinged += 10 * MS;
        assert_eq!(lifecycle.tick(pinged), []);
    }
    lifecycle.exited(CONTROL, Exit::Code(1), pinged);
    assert_eq!(lifecycle.next_deadline(), Some(pinged + 50 * MS));
}

#[test]
fn a_clean_end_is_not_restarted_and_exit_code_2_is_given_up() {
    for exit in [Exit::Code(0), Exit::Signal(signal_hook::consts::SIGTERM)] {
        let mut lifecycle = up();
        lifecycle.exited(CONTROL, exit, MS);
        assert_eq!(lifecycle.tick(Duration::from_secs(60)), []);
        assert_eq!(lifecycle.state(CONTROL), UnitState::Inactive);
    }
    let mut lifecycle = up();
    lifecycle.exited(CONTROL, Exit::Code(2), MS);
    assert_eq!(lifecycle.tick(Duration::from_secs(60)), []);
    assert_eq!(lifecycle.state(CONTROL), UnitState::Failed);
    assert_eq!(lifecycle.phase(), RigState::Up, "the others run on");
}

#[test]
fn silence_of_the_watchdog_kills() {
    let mut lifecycle = up();
    lifecycle.ping(CONTROL, false, 15 * MS);
    assert_eq!(lifecycle.next_deadline(), Some(35 * MS));
    assert_eq!(lifecycle.tick(34 * MS), []);
    assert_eq!(lifecycle.tick(35 * MS), [Action::Kill(CONTROL)]);
    assert_eq!(lifecycle.tick(36 * MS), [], "killed once");
    lifecycle.exited(CONTROL, Exit::Signal(9), 37 * MS);
    assert_eq!(lifecycle.state(CONTROL), UnitState::BackOff);
    assert!(
        lifecycle.reason(CONTROL).unwrap().contains("silent"),
        "the kill's reason stands, not the signal's"
    );
}

#[test]
fn no_worker_starts_while_the_keeper_is_down() {
    let mut lifecycle = up();
    lifecycle.exited(KEEPER, Exit::Signal(9), MS);
    assert_eq!(lifecycle.tick(MS), [], "a dead keeper takes nobody down");
    assert_eq!(lifecycle.state(CONTROL), UnitState::Ready);
    lifecycle.exited(CONTROL, Exit::Signal(9), 2 * MS);
    assert_eq!(lifecycle.tick(51 * MS), [Action::Start(KEEPER)]);
    assert_eq!(lifecycle.tick(60 * MS), [], "due, but the keeper is not ready");
    assert_eq!(lifecycle.state(CONTROL), UnitState::Gated);
    lifecycle.ready(KEEPER, 61 * MS);
    assert_eq!(lifecycle.tick(61 * MS), [Action::Start(CONTROL)]);
}

#[test]
fn a_keeper_that_was_ended_in_good_order_comes_again_for_who_needs_it() {
    let mut lifecycle = up();
    lifecycle.exited(KEEPER, Exit::Code(0), MS);
    assert_eq!(lifecycle.tick(10 * MS), [], "nobody needs it yet");
    assert_eq!(lifecycle.state(KEEPER), UnitState::Inactive);
    lifecycle.exited(CONTROL, Exit::Signal(9), 11 * MS);
    assert_eq!(lifecycle.next_deadline(), Some(61 * MS));
    assert_eq!(lifecycle.tick(61 * MS), [Action::Start(KEEPER)]);
    lifecycle.ready(KEEPER, 62 * MS);
    assert_eq!(lifecycle.tick(62 * MS), [Action::Start(CONTROL)]);
}

#[test]
fn what_outlives_its_kill_is_not_waited_for_when_all_is_stopped() {
    let mut lifecycle = up();
    assert_eq!(lifecycle.tick(20 * MS), [Action::Kill(CONTROL)], "its watchdog was silent");
    lifecycle.stop_all();
    assert_eq!(lifecycle.tick(25 * MS), [Action::AskToStop(WATCHDOG)]);
    lifecycle.exited(WATCHDOG, Exit::Code(0), 26 * MS);
    assert_eq!(lifecycle.tick(26 * MS), [], "the keeper waits for what is being killed");
    assert_eq!(lifecycle.next_deadline(), Some(50 * MS));
    assert_eq!(lifecycle.tick(50 * MS), [Action::AskToStop(KEEPER)]);
    assert_eq!(lifecycle.state(CONTROL), UnitState::Failed);
    assert!(lifecycle.reason(CONTROL).unwrap().contains("outlived"));
    lifecycle.exited(KEEPER, Exit::Code(0), 51 * MS);
    assert_eq!(lifecycle.tick(51 * MS), []);
    assert_eq!(lifecycle.phase(), RigState::Down);
}

#[test]
fn a_start_that_hangs_is_killed_and_tried_again_then_all_is_stopped() {
    let mut lifecycle = lifecycle();
    let mut now = Duration::ZERO;
    assert_eq!(lifecycle.tick(now), [Action::Start(KEEPER)]);
    lifecycle.ready(KEEPER, now);
    for attempt in 1..=START_ATTEMPTS {
        assert_eq!(lifecycle.tick(now), [Action::Start(CONTROL)], "attempt {attempt}");
        now += 100 * MS;
        assert_eq!(lifecycle.tick(now), [Action::Kill(CONTROL)]);
        lifecycle.exited(CONTROL, Exit::Signal(9), now);
        now += Duration::from_secs(1);
    }
    let failure = lifecycle.failure().unwrap();
    assert_eq!((failure.unit, failure.attempts), (CONTROL, START_ATTEMPTS));
    assert!(failure.reason.contains("not ready within 100ms"), "{}", failure.reason);
    assert_eq!(lifecycle.tick(now), [Action::AskToStop(KEEPER)]);
    lifecycle.exited(KEEPER, Exit::Code(0), now);
    assert_eq!(lifecycle.tick(now), []);
    assert_eq!(lifecycle.phase(), RigState::Down);
}

#[test]
fn stopped_in_the_reverse_order_and_killed_when_they_do_not_respond() {
    let mut lifecycle = up();
    lifecycle.stop_all();
    assert_eq!(lifecycle.tick(MS), [Action::AskToStop(WATCHDOG)]);
    assert_eq!(lifecycle.tick(30 * MS), []);
    assert_eq!(lifecycle.tick(31 * MS), [Action::Kill(WATCHDOG)]);
    lifecycle.exited(WATCHDOG, Exit::Signal(9), 32 * MS);
    assert_eq!(lifecycle.stop_of(WATCHDOG), Some((MS, true)));
    assert_eq!(lifecycle.tick(32 * MS), [Action::AskToStop(CONTROL)]);
    lifecycle.exited(CONTROL, Exit::Code(1), 33 * MS);
    assert_eq!(
        lifecycle.tick(33 * MS),
        [Action::AskToStop(KEEPER)],
        "what fails while stopping is not restarted"
    );
    assert_eq!(lifecycle.tick(63 * MS), [Action::Kill(KEEPER)]);
    assert_eq!(lifecycle.tick(93 * MS), [], "it hangs in the kernel: not waited for");
    assert_eq!(lifecycle.phase(), RigState::Down);
    assert_eq!(lifecycle.state(KEEPER), UnitState::Failed);
}

#[test]
fn a_storm_of_restarts_is_limited_until_a_person_asks() {
    let mut lifecycle = lifecycle();
    lifecycle.start_limit = 3;
    let mut now = Duration::ZERO;
    for unit in [KEEPER, CONTROL, WATCHDOG] {
        lifecycle.tick(now);
        lifecycle.ready(unit, now);
    }
    lifecycle.tick(now);
    for start in 1..=2 {
        lifecycle.exited(CONTROL, Exit::Code(1), now);
        now = lifecycle.next_deadline().unwrap();
        assert_eq!(lifecycle.tick(now), [Action::Start(CONTROL)], "restart {start}");
        lifecycle.ready(CONTROL, now);
    }
    lifecycle.exited(CONTROL, Exit::Code(1), now);
    assert_eq!(lifecycle.tick(now + Duration::from_secs(60)), []);
    assert_eq!(lifecycle.state(CONTROL), UnitState::Failed);
    assert!(lifecycle.reason(CONTROL).unwrap().contains("started 3 times within 20s"));
    assert_eq!(lifecycle.restart(CONTROL, now), Ok(vec![]));
    assert_eq!(lifecycle.tick(now), [Action::Start(CONTROL)]);
}

#[test]
fn starts_long_ago_do_not_count_as_a_storm() {
    let mut lifecycle = lifecycle();
    lifecycle.start_limit = 2;
    lifecycle.slots[CONTROL].unit.watchdog = UNWATCHED;
    let mut now = Duration::ZERO;
    for unit in [KEEPER, CONTROL, WATCHDOG] {
        lifecycle.tick(now);
        lifecycle.ready(unit, now);
    }
    lifecycle.tick(now);
    for _ in 0..5 {
        now += Duration::from_secs(20);
        lifecycle.exited(CONTROL, Exit::Code(1), now);
        now = lifecycle.next_deadline().unwrap();
        assert_eq!(lifecycle.tick(now), [Action::Start(CONTROL)]);
        lifecycle.ready(CONTROL, now);
    }
}

#[test]
fn a_restart_that_was_asked_for_stops_first() {
    let mut lifecycle = up();
    assert_eq!(lifecycle.restart(WATCHDOG, MS), Ok(vec![Action::AskToStop(WATCHDOG)]));
    assert_eq!(lifecycle.tick(2 * MS), []);
    lifecycle.exited(WATCHDOG, Exit::Code(0), 3 * MS);
    assert_eq!(lifecycle.tick(3 * MS), [Action::Start(WATCHDOG)]);
    lifecycle.stop_all();
    assert!(lifecycle.restart(WATCHDOG, 4 * MS).is_err());
}

#[test]
fn the_adopted_are_not_started_and_the_missing_are() {
    let mut lifecycle = lifecycle();
    lifecycle.adopt(KEEPER, true, 4, Duration::ZERO);
    lifecycle.adopt(CONTROL, false, 0, Duration::ZERO);
    assert_eq!(lifecycle.tick(MS), [], "the watchdog waits for control");
    lifecycle.ping(CONTROL, true, 2 * MS);
    assert_eq!(lifecycle.tick(2 * MS), [Action::Start(WATCHDOG)]);
    lifecycle.ready(WATCHDOG, 3 * MS);
    lifecycle.tick(3 * MS);
    assert_eq!(lifecycle.phase(), RigState::Up);
    assert_eq!(lifecycle.restarts(KEEPER), 4);
    lifecycle.exited(KEEPER, Exit::Unknown, 4 * MS);
    assert_eq!(lifecycle.tick(54 * MS).first(), Some(&Action::Kill(CONTROL)), "silent since 2 ms");
    assert_eq!(lifecycle.state(KEEPER), UnitState::Starting, "an unknown end counts as a failure");
}

#[test]
fn a_process_that_was_not_adopted_is_not_ready_by_a_ping() {
    let mut lifecycle = lifecycle();
    lifecycle.tick(Duration::ZERO);
    lifecycle.ping(KEEPER, false, MS);
    assert_eq!(lifecycle.state(KEEPER), UnitState::Starting);
}

#[test]
fn stopping_while_starting_stops_what_runs() {
    let mut lifecycle = lifecycle();
    lifecycle.tick(Duration::ZERO);
    lifecycle.stop_all();
    assert_eq!(lifecycle.tick(MS), [Action::AskToStop(KEEPER)]);
    lifecycle.exited(KEEPER, Exit::Signal(15), 2 * MS);
    lifecycle.tick(2 * MS);
    assert_eq!(lifecycle.phase(), RigState::Down);
    assert_eq!(lifecycle.failure(), None);
}

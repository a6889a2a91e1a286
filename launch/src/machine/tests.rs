use super::*;

const MS: Duration = Duration::from_millis(1);

/// keeper <- control (gated by keeper) <- watchdog (gated by keeper, after control).
fn policies() -> Vec<Policy> {
    let plain = Policy {
        after: vec![],
        gates: vec![],
        timeout_start: 100 * MS,
        timeout_stop: 30 * MS,
        watchdog: Some(20 * MS),
        restart: Restart::OnFailure,
        restart_delay: 50 * MS,
        restart_prevent_exit_status: vec![2],
        start_limit_burst: 0,
        start_limit_interval: Duration::from_secs(20),
    };
    vec![
        Policy { watchdog: None, ..plain.clone() },
        Policy { after: vec![0], gates: vec![0], ..plain.clone() },
        Policy { after: vec![0, 1], gates: vec![0], watchdog: None, ..plain },
    ]
}

const KEEPER: usize = 0;
const CONTROL: usize = 1;
const WATCHDOG: usize = 2;

fn up() -> Machine {
    let mut machine = Machine::new(policies());
    for unit in [KEEPER, CONTROL, WATCHDOG] {
        assert_eq!(machine.tick(Duration::ZERO), [Action::Start(unit)]);
        assert_eq!(machine.phase(), Phase::BringUp);
        machine.ready(unit, Duration::ZERO);
    }
    assert_eq!(machine.tick(Duration::ZERO), []);
    assert_eq!(machine.phase(), Phase::Up);
    machine
}

#[test]
fn a_crash_is_followed_by_growing_pauses_up_to_the_cap() {
    let mut machine = up();
    let mut now = 5 * MS;
    let mut pauses = Vec::new();
    for _ in 0..9 {
        machine.exited(CONTROL, Exit::Signal(9), now);
        assert_eq!(machine.tick(now), []);
        let due = machine.next_deadline().unwrap();
        assert_eq!(machine.tick(due - MS), []);
        assert_eq!(machine.tick(due), [Action::Start(CONTROL)]);
        pauses.push((due - now).as_millis());
        machine.ready(CONTROL, due);
        now = due + MS;
    }
    assert_eq!(pauses, [50, 100, 200, 400, 800, 1600, 2000, 2000, 2000]);
    assert_eq!(machine.restarts(CONTROL), 9);
    // Ready for long enough: the next restart comes at once again.
    let mut pinged = now;
    while pinged < now + HEALTHY_AFTER {
        machine.ping(CONTROL, false, pinged);
        pinged += 10 * MS;
        assert_eq!(machine.tick(pinged), []);
    }
    machine.exited(CONTROL, Exit::Code(1), pinged);
    assert_eq!(machine.next_deadline(), Some(pinged + 50 * MS));
}

#[test]
fn a_clean_end_is_not_restarted_and_exit_code_2_is_given_up() {
    for exit in [Exit::Code(0), Exit::Signal(libc::SIGTERM)] {
        let mut machine = up();
        machine.exited(CONTROL, exit, MS);
        assert_eq!(machine.tick(Duration::from_secs(60)), []);
        assert_eq!(machine.state(CONTROL), UnitState::Inactive);
    }
    let mut machine = up();
    machine.exited(CONTROL, Exit::Code(2), MS);
    assert_eq!(machine.tick(Duration::from_secs(60)), []);
    assert_eq!(machine.state(CONTROL), UnitState::Failed);
    assert_eq!(machine.phase(), Phase::Up, "the others run on");
}

#[test]
fn silence_of_the_watchdog_kills() {
    let mut machine = up();
    machine.ping(CONTROL, false, 15 * MS);
    assert_eq!(machine.next_deadline(), Some(35 * MS));
    assert_eq!(machine.tick(34 * MS), []);
    assert_eq!(machine.tick(35 * MS), [Action::Kill(CONTROL)]);
    assert_eq!(machine.tick(36 * MS), [], "killed once");
    machine.exited(CONTROL, Exit::Signal(9), 37 * MS);
    assert_eq!(machine.state(CONTROL), UnitState::BackOff);
    assert!(
        machine.reason(CONTROL).unwrap().contains("silent"),
        "the kill's reason stands, not the signal's"
    );
}

#[test]
fn no_worker_starts_while_the_keeper_is_down() {
    let mut machine = up();
    machine.exited(KEEPER, Exit::Signal(9), MS);
    assert_eq!(machine.tick(MS), [], "a dead keeper takes nobody down");
    assert_eq!(machine.state(CONTROL), UnitState::Ready);
    machine.exited(CONTROL, Exit::Signal(9), 2 * MS);
    assert_eq!(machine.tick(51 * MS), [Action::Start(KEEPER)]);
    assert_eq!(machine.tick(60 * MS), [], "due, but the keeper is not ready");
    assert_eq!(machine.state(CONTROL), UnitState::Gated);
    machine.ready(KEEPER, 61 * MS);
    assert_eq!(machine.tick(61 * MS), [Action::Start(CONTROL)]);
}

#[test]
fn a_keeper_that_was_ended_in_good_order_comes_again_for_who_needs_it() {
    let mut machine = up();
    machine.exited(KEEPER, Exit::Code(0), MS);
    assert_eq!(machine.tick(10 * MS), [], "nobody needs it yet");
    assert_eq!(machine.state(KEEPER), UnitState::Inactive);
    machine.exited(CONTROL, Exit::Signal(9), 11 * MS);
    assert_eq!(machine.next_deadline(), Some(61 * MS));
    assert_eq!(machine.tick(61 * MS), [Action::Start(KEEPER)]);
    machine.ready(KEEPER, 62 * MS);
    assert_eq!(machine.tick(62 * MS), [Action::Start(CONTROL)]);
}

#[test]
fn what_outlives_its_kill_is_not_waited_for_when_all_is_stopped() {
    let mut machine = up();
    assert_eq!(machine.tick(20 * MS), [Action::Kill(CONTROL)], "its watchdog was silent");
    machine.stop_all();
    assert_eq!(machine.tick(25 * MS), [Action::AskToStop(WATCHDOG)]);
    machine.exited(WATCHDOG, Exit::Code(0), 26 * MS);
    assert_eq!(machine.tick(26 * MS), [], "the keeper waits for what is being killed");
    assert_eq!(machine.next_deadline(), Some(50 * MS));
    assert_eq!(machine.tick(50 * MS), [Action::AskToStop(KEEPER)]);
    assert_eq!(machine.state(CONTROL), UnitState::Failed);
    assert!(machine.reason(CONTROL).unwrap().contains("outlived"));
    machine.exited(KEEPER, Exit::Code(0), 51 * MS);
    assert_eq!(machine.tick(51 * MS), []);
    assert_eq!(machine.phase(), Phase::Down);
}

#[test]
fn a_start_that_hangs_is_killed_and_tried_again_then_all_is_stopped() {
    let mut machine = Machine::new(policies());
    let mut now = Duration::ZERO;
    assert_eq!(machine.tick(now), [Action::Start(KEEPER)]);
    machine.ready(KEEPER, now);
    for attempt in 1..=START_ATTEMPTS {
        assert_eq!(machine.tick(now), [Action::Start(CONTROL)], "attempt {attempt}");
        now += 100 * MS;
        assert_eq!(machine.tick(now), [Action::Kill(CONTROL)]);
        machine.exited(CONTROL, Exit::Signal(9), now);
        now += Duration::from_secs(1);
    }
    let failure = machine.failure().unwrap();
    assert_eq!((failure.unit, failure.attempts), (CONTROL, START_ATTEMPTS));
    assert!(failure.reason.contains("not ready within 100ms"), "{}", failure.reason);
    assert_eq!(machine.tick(now), [Action::AskToStop(KEEPER)]);
    machine.exited(KEEPER, Exit::Code(0), now);
    assert_eq!(machine.tick(now), []);
    assert_eq!(machine.phase(), Phase::Down);
}

#[test]
fn stopped_in_the_reverse_order_and_killed_when_deaf() {
    let mut machine = up();
    machine.stop_all();
    assert_eq!(machine.tick(MS), [Action::AskToStop(WATCHDOG)]);
    assert_eq!(machine.tick(30 * MS), []);
    assert_eq!(machine.tick(31 * MS), [Action::Kill(WATCHDOG)]);
    machine.exited(WATCHDOG, Exit::Signal(9), 32 * MS);
    assert_eq!(machine.stop_of(WATCHDOG), Some((MS, true)));
    assert_eq!(machine.tick(32 * MS), [Action::AskToStop(CONTROL)]);
    machine.exited(CONTROL, Exit::Code(1), 33 * MS);
    assert_eq!(
        machine.tick(33 * MS),
        [Action::AskToStop(KEEPER)],
        "what fails while stopping is not restarted"
    );
    assert_eq!(machine.tick(63 * MS), [Action::Kill(KEEPER)]);
    assert_eq!(machine.tick(93 * MS), [], "it hangs in the kernel: not waited for");
    assert_eq!(machine.phase(), Phase::Down);
    assert_eq!(machine.state(KEEPER), UnitState::Failed);
}

#[test]
fn a_storm_of_restarts_is_limited_until_a_person_asks() {
    let mut policies = policies();
    policies[CONTROL].start_limit_burst = 3;
    let mut machine = Machine::new(policies);
    let mut now = Duration::ZERO;
    for unit in [KEEPER, CONTROL, WATCHDOG] {
        machine.tick(now);
        machine.ready(unit, now);
    }
    machine.tick(now);
    for start in 1..=2 {
        machine.exited(CONTROL, Exit::Code(1), now);
        now = machine.next_deadline().unwrap();
        assert_eq!(machine.tick(now), [Action::Start(CONTROL)], "restart {start}");
        machine.ready(CONTROL, now);
    }
    machine.exited(CONTROL, Exit::Code(1), now);
    assert_eq!(machine.tick(now + Duration::from_secs(60)), []);
    assert_eq!(machine.state(CONTROL), UnitState::Failed);
    assert!(machine.reason(CONTROL).unwrap().contains("started 3 times within 20s"));
    assert_eq!(machine.restart(CONTROL, now), Ok(vec![]));
    assert_eq!(machine.tick(now), [Action::Start(CONTROL)]);
}

#[test]
fn starts_long_ago_do_not_count_as_a_storm() {
    let mut policies = policies();
    policies[CONTROL].start_limit_burst = 2;
    policies[CONTROL].watchdog = None;
    let mut machine = Machine::new(policies);
    let mut now = Duration::ZERO;
    for unit in [KEEPER, CONTROL, WATCHDOG] {
        machine.tick(now);
        machine.ready(unit, now);
    }
    machine.tick(now);
    for _ in 0..5 {
        now += Duration::from_secs(20);
        machine.exited(CONTROL, Exit::Code(1), now);
        now = machine.next_deadline().unwrap();
        assert_eq!(machine.tick(now), [Action::Start(CONTROL)]);
        machine.ready(CONTROL, now);
    }
}

#[test]
fn a_restart_that_was_asked_for_stops_first() {
    let mut machine = up();
    assert_eq!(machine.restart(WATCHDOG, MS), Ok(vec![Action::AskToStop(WATCHDOG)]));
    assert_eq!(machine.tick(2 * MS), []);
    machine.exited(WATCHDOG, Exit::Code(0), 3 * MS);
    assert_eq!(machine.tick(3 * MS), [Action::Start(WATCHDOG)]);
    machine.stop_all();
    assert!(machine.restart(WATCHDOG, 4 * MS).is_err());
}

#[test]
fn the_adopted_are_not_started_and_the_missing_are() {
    let mut machine = Machine::new(policies());
    machine.adopt(KEEPER, true, 4, Duration::ZERO);
    machine.adopt(CONTROL, false, 0, Duration::ZERO);
    assert_eq!(machine.tick(MS), [], "the watchdog waits for control");
    machine.ping(CONTROL, true, 2 * MS);
    assert_eq!(machine.tick(2 * MS), [Action::Start(WATCHDOG)]);
    machine.ready(WATCHDOG, 3 * MS);
    machine.tick(3 * MS);
    assert_eq!(machine.phase(), Phase::Up);
    assert_eq!(machine.restarts(KEEPER), 4);
    machine.exited(KEEPER, Exit::Unknown, 4 * MS);
    assert_eq!(machine.tick(54 * MS).first(), Some(&Action::Kill(CONTROL)), "silent since 2 ms");
    assert_eq!(machine.state(KEEPER), UnitState::Starting, "an unknown end counts as a failure");
}

#[test]
fn a_process_that_was_not_adopted_is_not_ready_by_a_ping() {
    let mut machine = Machine::new(policies());
    machine.tick(Duration::ZERO);
    machine.ping(KEEPER, false, MS);
    assert_eq!(machine.state(KEEPER), UnitState::Starting);
}

#[test]
fn stopping_while_starting_stops_what_runs() {
    let mut machine = Machine::new(policies());
    machine.tick(Duration::ZERO);
    machine.stop_all();
    assert_eq!(machine.tick(MS), [Action::AskToStop(KEEPER)]);
    machine.exited(KEEPER, Exit::Signal(15), 2 * MS);
    machine.tick(2 * MS);
    assert_eq!(machine.phase(), Phase::Down);
    assert_eq!(machine.failure(), None);
}

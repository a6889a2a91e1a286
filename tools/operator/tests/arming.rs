//! Arming beside a stand-in for the watchdog: whoever agreed to arm may not be who pressed the
//! emergency stop, so one that comes meanwhile holds. (One rig: the library's configuration is
//! process-wide.)
#![allow(clippy::unwrap_used)]

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use iceoryx2::port::publisher::Publisher;
use iceoryx2::prelude::ipc;
use ipc_types::{
    EnableToken, TOKEN, TripCause, Verb, VerbAnswer, WATCHDOG_COMMANDS, WatchdogState,
};
use operator::{Error, RigLink, reset_and_arm};
use runtime::{Domain, Keeper, RigName, Server};

/// When somebody presses the emergency stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Pressed {
    Never,
    BeforeAll,
    JustBeforeReset,
    JustAfterReset,
    JustBeforeArm,
    JustAfterArm,
}

/// State and cause, as a token shows them.
type Shown = (WatchdogState, TripCause);

const STOPPED: Shown = (WatchdogState::Tripped, TripCause::EmergencyStop);
const DISARMED: Shown = (WatchdogState::Disarmed, TripCause::None);

/// What a verb leads to, state after state.
fn states_after(verb: Verb, from: Shown, pressed: Pressed) -> Vec<Shown> {
    let armed = (WatchdogState::Armed, TripCause::None);
    match (verb, pressed) {
        (Verb::Estop, _) => vec![STOPPED],
        (Verb::Reset, Pressed::JustBeforeReset) => vec![STOPPED, DISARMED],
        (Verb::Reset, Pressed::JustAfterReset) => vec![DISARMED, STOPPED],
        (Verb::Reset, _) => vec![DISARMED],
        (Verb::Arm, Pressed::JustBeforeArm) => vec![STOPPED],
        (Verb::Arm, Pressed::JustAfterArm) => vec![armed, STOPPED],
        (Verb::Arm, _) => vec![armed],
        (_, _) => vec![from],
    }
}

fn show(tokens: &Publisher<ipc::Service, EnableToken, ()>, (state, cause): Shown) {
    let token = EnableToken { state: state.code(), cause: cause.code(), ..EnableToken::default() };
    tokens.loan_uninit().unwrap().write_payload(token).send().unwrap();
}

/// Executes verbs and publishes tokens, if `talks`, until `finish`; returns the verbs, and the
/// state in which they left it.
fn stand_in(
    rig: &RigName,
    pressed: Pressed,
    talks: bool,
    finish: &AtomicBool,
) -> (Vec<Verb>, Shown) {
    let domain = Domain::open(rig).unwrap();
    let node = domain.node("watchdog").unwrap();
    let topic = node.service_builder(&TOKEN.topic.name.try_into().unwrap());
    let topic = topic.publish_subscribe::<EnableToken>().open().unwrap();
    let tokens = topic.publisher_builder().create().unwrap();
    let server = Server::new(&node, &WATCHDOG_COMMANDS).unwrap();
    let mut verbs = Vec::new();
    let mut shown = match pressed {
        Pressed::BeforeAll => STOPPED,
        _ => (WatchdogState::Tripped, TripCause::SpeedLimit),
    };
    while !finish.load(Ordering::Relaxed) {
        let execute = |verb: Verb| {
            verbs.push(verb);
            let done = verb != Verb::Arm || shown == DISARMED && pressed != Pressed::JustBeforeArm;
            // Before the answer, so that the client has them with it, however late it wakes.
            for next in states_after(verb, shown, pressed) {
                shown = next;
                show(&tokens, shown);
            }
            VerbAnswer { done, state: shown.0, reason: String::new() }
        };
        server.poll(execute, |error| panic!("{error}")).unwrap();
        if talks {
            show(&tokens, shown);
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    (verbs, shown)
}

/// Arms beside the stand-in; returns what came of it, the verbs, and the state at the end.
fn armed(rig: &RigName, pressed: Pressed, talks: bool) -> (Result<(), Error>, Vec<Verb>, Shown) {
    let finish = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let watchdog = scope.spawn(|| stand_in(rig, pressed, talks, &finish));
        let link = RigLink::open(rig).unwrap();
        // A watchdog that says nothing is tried once.
        let stop = AtomicBool::new(!talks);
        let result = reset_and_arm(&link, &stop, &mut |_| {});
        finish.store(true, Ordering::Relaxed);
        let (verbs, shown) = watchdog.join().unwrap();
        (result, verbs, shown)
    })
}

/// The shared memory of a rig, removed in any case.
struct Founded {
    name: RigName,
    keeper: Option<Keeper>,
}

impl Drop for Founded {
    fn drop(&mut self) {
        if let Some(mut keeper) = self.keeper.take() {
            keeper.clean(Duration::ZERO);
            let _ended = keeper.end();
        }
        let _removed = self.name.remove();
    }
}

#[test]
fn an_emergency_stop_is_not_overridden_by_arming() {
    let name: RigName = format!("arming-{}", std::process::id()).parse().unwrap();
    let _founded = Founded { keeper: Some(Keeper::start(&name).unwrap()), name: name.clone() };

    let (result, verbs, shown) = armed(&name, Pressed::Never, true);
    result.unwrap();
    assert_eq!(verbs, [Verb::Reset, Verb::Arm]);
    assert_eq!(shown.0, WatchdogState::Armed);

    use Verb::{Arm, Estop, Reset};
    let cases: [(Pressed, &[Verb]); 5] = [
        (Pressed::BeforeAll, &[]),
        // The reset takes it away, so it is given again.
        (Pressed::JustBeforeReset, &[Reset, Estop]),
        (Pressed::JustAfterReset, &[Reset, Estop]),
        (Pressed::JustBeforeArm, &[Reset, Arm, Estop]),
        (Pressed::JustAfterArm, &[Reset, Arm, Estop]),
    ];
    for (pressed, expected) in cases {
        let (result, verbs, shown) = armed(&name, pressed, true);
        assert!(matches!(result, Err(Error::EmergencyStopped)), "{pressed:?}: {result:?}");
        assert_eq!(verbs, expected, "{pressed:?}");
        assert_eq!(shown, STOPPED, "{pressed:?}");
    }

    let (result, verbs, _) = armed(&name, Pressed::Never, false);
    assert!(matches!(result, Err(Error::NoWatchdog(_))), "{result:?}");
    assert_eq!(verbs, [], "nothing is armed without a token that shows that nobody stopped it");
}

//! Verbs between the watchdog's command thread and its loop (`services/watchdog`).
#![cfg(loom)]

use interleavings::explore;
use ipc_types::{Verb, WatchdogState};
use loom::sync::Arc;
use loom::thread;
use verb_exchange::{Answer, VerbExchange};

mod sync {
    pub(crate) use interleavings::ArrayQueue;
    pub(crate) use loom::sync::atomic::{AtomicU64, Ordering};
}

mod interlock {
    /// Why a verb was refused.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub(crate) enum Refusal {
        /// The machine moves.
        Moving,
    }
}

#[path = "../../../services/watchdog/src/verb_exchange.rs"]
mod verb_exchange;

const VERBS: [Verb; 3] = [Verb::Estop, Verb::Reset, Verb::Arm];

/// Answers that tell which verb they belong to.
fn answer_of(verb: Verb) -> Answer {
    match verb {
        Verb::Estop => Ok(WatchdogState::Tripped),
        Verb::Reset => Ok(WatchdogState::Disarmed),
        _ => Err(interlock::Refusal::Moving),
    }
}

/// What became of a verb, as the command thread sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fate {
    Answered,
    TakenBack,
    /// The loop has taken it and not yet answered.
    Late,
}

/// The command thread: asks, looks so many times, gives up.
fn command_thread(exchange: &VerbExchange, looks: usize) -> Vec<(Verb, Fate)> {
    VERBS
        .into_iter()
        .filter_map(|verb| {
            let ticket = exchange.ask(verb).expect("the place is free: the last was given up");
            let found = (0..looks).find_map(|_| exchange.answer_to(&ticket));
            match found {
                Some(answer) => {
                    assert_eq!(answer, answer_of(verb), "the answer to another verb");
                    Some((verb, Fate::Answered))
                }
                None if exchange.give_up(ticket) => Some((verb, Fate::TakenBack)),
                None => Some((verb, Fate::Late)),
            }
        })
        .collect()
}

/// The loop: so many cycles, with one verb each at most.
fn watchdog_loop(exchange: &VerbExchange, cycles: usize) -> Vec<Verb> {
    let mut executed = Vec::new();
    for _ in 0..cycles {
        if let Some(order) = exchange.take() {
            executed.push(order.verb);
            exchange.answer(order, answer_of(order.verb));
        }
    }
    executed
}

#[test]
fn a_verb_is_executed_once_or_taken_back_and_answered_by_its_own() {
    for (looks, cycles) in [(1, 2), (1, 3), (2, 2), (2, 3)] {
        explore(&format!("verbs, {looks} looks, {cycles} cycles"), None, move || {
            let exchange = Arc::new(VerbExchange::new());
            let other = Arc::clone(&exchange);
            let thread = thread::spawn(move || watchdog_loop(&other, cycles));
            let fates = command_thread(&exchange, looks);
            let executed = thread.join().unwrap();
            for (verb, fate) in fates {
                let times = executed.iter().filter(|done| **done == verb).count();
                assert_eq!(times, usize::from(fate != Fate::TakenBack), "{verb}: {fate:?}");
            }
        });
    }
}

//! How a verb passes from the command thread to the loop, and its answer back. Nothing here
//! blocks: both sides use queues of one place.
//!
//! The command thread gives up on a loop that does not answer in time. A verb that the loop has
//! not taken by then is taken back, so that it is never executed behind the operator's back; one
//! that it has taken is executed, and its answer, which comes too late, must not pass for that of a
//! later verb. So verbs have numbers.

use ipc_types::{Verb, WatchdogState};

use crate::interlock::Refusal;
use crate::sync::{ArrayQueue, AtomicU64, Ordering};

/// What the interlock says to a verb.
pub(crate) type Answer = Result<WatchdogState, Refusal>;

/// A verb on its way, with its number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Order {
    number: u64,
    /// What to do.
    pub(crate) verb: Verb,
}

/// The number of a verb that was handed over, for its answer.
#[derive(Debug)]
pub(crate) struct Ticket(u64);

/// Both directions.
#[derive(Debug)]
pub(crate) struct VerbExchange {
    orders: ArrayQueue<Order>,
    answers: ArrayQueue<(u64, Answer)>,
    next: AtomicU64,
}

impl VerbExchange {
    pub(crate) fn new() -> Self {
        Self { orders: ArrayQueue::new(1), answers: ArrayQueue::new(1), next: AtomicU64::new(0) }
    }

    /// The command thread hands a verb over; `None` while an earlier one was not taken.
    pub(crate) fn ask(&self, verb: Verb) -> Option<Ticket> {
        let number = self.next.fetch_add(1, Ordering::Relaxed);
        self.orders.push(Order { number, verb }).ok().map(|()| Ticket(number))
    }

    /// The command thread looks for the answer. Those to earlier verbs are dropped.
    pub(crate) fn answer_to(&self, ticket: &Ticket) -> Option<Answer> {
        std::iter::from_fn(|| self.answers.pop())
            .find_map(|(number, answer)| (number == ticket.0).then_some(answer))
    }

    /// The command thread waits no longer. Returns whether the verb was taken back: then it is
    /// never executed.
    pub(crate) fn give_up(&self, _ticket: Ticket) -> bool {
        // Only one is handed over at a time, so that this is the ticket's own.
        self.orders.pop().is_some()
    }

    /// The loop takes a verb, if there is one.
    pub(crate) fn take(&self) -> Option<Order> {
        self.orders.pop()
    }

    /// The loop answers. An answer that nobody has fetched makes room.
    pub(crate) fn answer(&self, order: Order, answer: Answer) {
        self.answers.force_push((order.number, answer));
    }
}

#[cfg(test)]
#[cfg(not(loom))]
mod tests {
    use super::*;

    const VERBS: [Verb; 3] = [Verb::Estop, Verb::Reset, Verb::Arm];

    /// One of the two threads, as far as it has come.
    #[derive(Clone, Copy)]
    enum Step {
        /// The command thread asks for its next verb.
        Ask,
        /// It looks for the answer.
        Look,
        /// It gives up.
        GiveUp,
        /// The loop takes a verb.
        Take,
        /// The loop answers the one that it has taken.
        Answer,
    }

    /// What an interleaving has led to.
    #[derive(Default)]
    struct Run {
        asked: usize,
        ticket: Option<Ticket>,
        taken: Option<Order>,
        executed: Vec<Verb>,
        taken_back: Vec<Verb>,
        answered: usize,
    }

    /// Answers that tell which verb they belong to.
    fn answer_of(verb: Verb) -> Answer {
        match verb {
            Verb::Estop => Ok(WatchdogState::Tripped),
            Verb::Reset => Ok(WatchdogState::Disarmed),
            _ => Err(Refusal::Moving),
        }
    }

    impl Run {
        /// One step of either thread; those that have no meaning now do nothing.
        fn step(&mut self, exchange: &VerbExchange, step: Step) {
            match step {
                Step::Ask => {
                    if self.ticket.is_none() && self.asked < VERBS.len() {
                        self.ticket = exchange.ask(VERBS[self.asked]);
                        assert!(self.ticket.is_some(), "the place is free");
                        self.asked += 1;
                    }
                }
                Step::Look => {
                    let found = self.ticket.as_ref().and_then(|own| exchange.answer_to(own));
                    if let Some(answer) = found {
                        let verb = VERBS[self.asked - 1];
                        assert_eq!(answer, answer_of(verb), "the answer to another verb");
                        assert_eq!(self.executed.last(), Some(&verb));
                        self.ticket = None;
                        self.answered += 1;
                    }
                }
                Step::GiveUp => {
                    if let Some(ticket) = self.ticket.take()
                        && exchange.give_up(ticket)
                    {
                        self.taken_back.push(VERBS[self.asked - 1]);
                    }
                }
                Step::Take => {
                    if self.taken.is_none()
                        && let Some(order) = exchange.take()
                    {
                        self.executed.push(order.verb);
                        self.taken = Some(order);
                    }
                }
                Step::Answer => {
                    if let Some(order) = self.taken.take() {
                        exchange.answer(order, answer_of(order.verb));
                    }
                }
            }
        }
    }

    /// Every interleaving of nine steps of the two threads, 5⁹ in all.
    #[test]
    fn in_every_interleaving_a_verb_is_executed_once_or_taken_back_and_answered_by_its_own() {
        const STEPS: [Step; 5] = [Step::Ask, Step::Look, Step::GiveUp, Step::Take, Step::Answer];
        const LENGTH: u32 = 9;
        let (mut answered, mut late, mut taken_back) = (0u64, 0u64, 0u64);
        for interleaving in 0..5usize.pow(LENGTH) {
            let exchange = VerbExchange::new();
            let mut run = Run::default();
            let mut rest = interleaving;
            for _ in 0..LENGTH {
                run.step(&exchange, STEPS[rest % 5]);
                rest /= 5;
            }
            // Each verb once at most, in the order of asking, and none that was taken back.
            let mut left = VERBS[..run.asked].iter();
            assert!(run.executed.iter().all(|verb| left.any(|asked| asked == verb)));
            assert!(run.taken_back.iter().all(|verb| !run.executed.contains(verb)));
            answered += run.answered as u64;
            taken_back += run.taken_back.len() as u64;
            late += u64::from(run.executed.len() > run.answered + 1);
        }
        // The interleavings try what they are for.
        assert!(answered > 1000 && late > 1000 && taken_back > 1000);
    }
}

//! Reset and arm, for a person who has agreed to it.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use ipc_types::{EnableToken, TOKEN, Verb, WatchdogState};
use runtime::Subscriber;

use crate::run::not_armed;
use crate::{Error, RigLink, verb};

/// How long a verb may be refused, while processes start again and faults clear.
const VERB_LIMIT: Duration = Duration::from_secs(15);
const PAUSE: Duration = Duration::from_millis(100);
/// Some periods of the watchdog, after which a token shows the new state.
const SETTLED: Duration = Duration::from_millis(20);

/// Resets and arms the rig; while a verb is refused both are tried again. `progress` is told why.
/// Call it only for a person who has agreed to it: no process arms anything.
///
/// # Errors
/// The last refusal, where a verb is still refused after 15 s or `stop` is set.
pub fn reset_and_arm(
    link: &RigLink,
    stop: &AtomicBool,
    progress: &mut dyn FnMut(&str),
) -> Result<(), Error> {
    let begun = Instant::now();
    let mut tokens = link.subscriber(TOKEN)?;
    loop {
        let refused = match once(link, &mut tokens) {
            Ok(()) => return Ok(()),
            Err(refused) => refused,
        };
        if begun.elapsed() > VERB_LIMIT || stop.load(Ordering::Relaxed) {
            return Err(refused);
        }
        progress(&refused.to_string());
        std::thread::sleep(PAUSE);
    }
}

fn once(link: &RigLink, tokens: &mut Subscriber<EnableToken>) -> Result<(), Error> {
    for each in [Verb::Reset, Verb::Arm] {
        verb(link, each)?;
    }
    std::thread::sleep(SETTLED);
    let token = tokens.latest()?.unwrap_or_default();
    match WatchdogState::from_code(token.state) {
        Some(WatchdogState::Armed) => Ok(()),
        _ => Err(not_armed(&token)),
    }
}

//! Reset and arm, for a person who has agreed to it.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use ipc_types::{EnableToken, TOKEN, TripCause, Verb, WatchdogState};
use runtime::Subscriber;

use crate::run::not_armed;
use crate::{Error, RigLink, verb};

/// How long a verb may be refused, while processes start again and faults clear.
const VERB_LIMIT: Duration = Duration::from_secs(15);
const PAUSE: Duration = Duration::from_millis(100);
/// Some periods of the watchdog, after which a token shows the new state.
const SETTLED: Duration = Duration::from_millis(20);

/// Resets and arms the rig; while a verb is refused both are tried again. `progress` is told why.
/// Call it only for a person who has agreed to it: no process arms anything. An emergency stop is
/// left as it is, also one that comes meanwhile: who agreed may not be who pressed it.
///
/// # Errors
/// [`Error::EmergencyStopped`]; or the last refusal, or the silence of the watchdog, where that
/// goes on for 15 s or `stop` is set.
pub fn reset_and_arm(
    link: &RigLink,
    stop: &AtomicBool,
    progress: &mut dyn FnMut(&str),
) -> Result<(), Error> {
    let begun = Instant::now();
    let mut tokens = link.subscriber(TOKEN)?;
    // Until a first token has shown whether the rig is stopped already.
    std::thread::sleep(SETTLED);
    loop {
        let refused = match once(link, &mut tokens) {
            Ok(()) => return Ok(()),
            Err(stopped @ Error::EmergencyStopped) => return Err(stopped),
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
    // Without a token nothing shows that the rig is not stopped.
    let silence_ms = SETTLED.as_millis() as u64;
    newest_unless_stopped(tokens)?.ok_or(Error::NoWatchdog(silence_ms))?;
    let reset = verb(link, Verb::Reset);
    // A rig that somebody has stopped is not armed, not even until this is seen.
    settled(link, tokens)?;
    reset?;
    let armed = verb(link, Verb::Arm);
    let token = settled(link, tokens)?;
    armed?;
    match WatchdogState::from_code(token.state) {
        Some(WatchdogState::Armed) => Ok(()),
        _ => Err(not_armed(&token)),
    }
}

/// The newest token, once it shows the last verb; unless one of those that came shows an emergency
/// stop, which then holds again.
fn settled(link: &RigLink, tokens: &mut Subscriber<EnableToken>) -> Result<EnableToken, Error> {
    std::thread::sleep(SETTLED);
    match newest_unless_stopped(tokens) {
        Ok(token) => Ok(token.unwrap_or_default()),
        Err(stopped) => {
            // It came just before the reset, which took it away. The refusal of a second one
            // does not let the rig be armed.
            let _refused = verb(link, Verb::Estop);
            Err(stopped)
        }
    }
}

/// The newest token, unless one of those that came shows an emergency stop.
fn newest_unless_stopped(
    tokens: &mut Subscriber<EnableToken>,
) -> Result<Option<EnableToken>, Error> {
    let mut newest = None;
    while let Some(token) = tokens.take()? {
        if shows_emergency_stop(&token) {
            return Err(Error::EmergencyStopped);
        }
        newest = Some(token);
    }
    Ok(newest)
}

fn shows_emergency_stop(token: &EnableToken) -> bool {
    let tripped = WatchdogState::from_code(token.state) == Some(WatchdogState::Tripped);
    tripped && TripCause::from_code(token.cause) == Some(TripCause::EmergencyStop)
}

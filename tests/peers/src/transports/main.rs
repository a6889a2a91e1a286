//! Publishes samples at 2 kHz, or reads the newest one in each period, over one of several
//! transports, and says how long that took: `.ci/measure.py peers` runs the two sides as two
//! processes on two processors.
//!
//! ```text
//! transports farreach keep NAME
//! transports TRANSPORT read NAME PROCESSOR PRIORITY       until SIGTERM; prints `ready` first
//! transports TRANSPORT publish NAME PROCESSOR PRIORITY SECONDS
//! ```
//!
//! TRANSPORT is `farreach` (the ports of its processes; needs a keeper), `iceoryx2` (the library
//! alone with the same settings), `datagrams` (Unix datagram sockets), `zenoh` (its own protocol on
//! a Unix socket) or `zenoh-shared` (the same, payloads in its shared memory). NAME tells
//! measurements apart. PRIORITY is that of `SCHED_FIFO`; 0 is ordinary scheduling.

mod datagrams;
mod farreach;
mod iceoryx2_alone;
mod loops;
#[cfg(feature = "zenoh")]
mod zenoh_session;

use std::process::ExitCode;

use ipc_types::{Profile, Sample};
use runtime::{bind, realtime};
use serde_json::Value;

/// What went wrong, in words.
type Failure = Box<dyn std::error::Error>;
/// Publishes a sample.
type Publish = Box<dyn FnMut(Sample) -> Result<(), Failure>>;
/// The newest sample that came since the last call.
type Read = Box<dyn FnMut() -> Result<Option<Sample>, Failure>>;

const USAGE: &str = "usage: transports farreach keep NAME | transports TRANSPORT read NAME \
                     PROCESSOR PRIORITY | transports TRANSPORT publish NAME PROCESSOR PRIORITY \
                     SECONDS";

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    let done = match words.as_slice() {
        ["farreach", "keep", name] => farreach::keep(name).map(|()| None),
        [transport, "read", name, processor, priority] => {
            read(transport, name, processor, priority).map(Some)
        }
        [transport, "publish", name, processor, priority, seconds] => {
            publish(transport, name, processor, priority, seconds).map(Some)
        }
        _ => {
            eprintln!("{USAGE}");
            return ExitCode::from(2);
        }
    };
    match done {
        Ok(found) => {
            if let Some(found) = found {
                println!("{found}");
            }
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("transports {}: {error}", words.join(" "));
            ExitCode::FAILURE
        }
    }
}

fn publish(
    transport: &str,
    name: &str,
    processor: &str,
    priority: &str,
    seconds: &str,
) -> Result<Value, Failure> {
    let publish = match transport {
        "farreach" => farreach::publisher(name)?,
        "iceoryx2" => iceoryx2_alone::publisher(name)?,
        "datagrams" => datagrams::publisher(name)?,
        #[cfg(feature = "zenoh")]
        "zenoh" | "zenoh-shared" => zenoh_session::publisher(name, transport == "zenoh-shared")?,
        _ => return Err(unknown(transport)),
    };
    schedule(processor, priority)?;
    loops::publish(seconds.parse()?, publish)
}

fn read(transport: &str, name: &str, processor: &str, priority: &str) -> Result<Value, Failure> {
    let read = match transport {
        "farreach" => farreach::reader(name)?,
        "iceoryx2" => iceoryx2_alone::reader(name)?,
        "datagrams" => datagrams::reader(name)?,
        #[cfg(feature = "zenoh")]
        "zenoh" | "zenoh-shared" => zenoh_session::reader(name, transport == "zenoh-shared")?,
        _ => return Err(unknown(transport)),
    };
    schedule(processor, priority)?;
    println!("ready");
    loops::read(read)
}

fn unknown(transport: &str) -> Failure {
    format!(
        "expected a transport: farreach, iceoryx2, datagrams, zenoh, zenoh-shared; found \
         {transport}. {USAGE}"
    )
    .into()
}

/// Gives the calling thread what a rig's loop has, as far as it is granted. Threads that a library
/// has started before keep what they have.
fn schedule(processor: &str, priority: &str) -> Result<(), Failure> {
    let processor = processor.parse()?;
    bind(processor).ok_or_else(|| format!("processor {processor}: cannot run there"))?;
    match priority.parse()? {
        0 => realtime::request_normal(),
        priority => {
            realtime::lock_memory();
            if realtime::request_fifo(priority) != Profile::Realtime {
                return Err("SCHED_FIFO was not granted: take priority 0".into());
            }
        }
    }
    realtime::tighten_timer_slack();
    realtime::prefault_stack();
    Ok(())
}

//! The logger process: all topics to disk.
//!
//! Its core needs neither shared memory nor a clock: [`recorder_front_end`] counts the messages and
//! hands them over a bounded queue to the thread that owns the file; [`state`] remembers what is
//! being recorded, so that a logger that was killed continues with the next part. [`run`] is the
//! process.

#[cfg(test)]
mod interleavings;
mod process;
mod recorder_error;
pub mod recorder_front_end;
mod ring;
pub mod state;
mod writer_queue;
mod writer_thread;

pub use process::{Logger, LoggerError, Options, revision, run};
pub use writer_queue::{BYTES as QUEUE_BYTES, HEADER_BYTES as QUEUE_HEADER_BYTES, RingParts};
pub use writer_thread::Opener;

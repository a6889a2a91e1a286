//! The logger process: all topics to disk.
//!
//! Its core knows neither shared memory nor a clock: [`sink`] counts what comes and hands it over a
//! bounded [`queue`] to the thread that owns the file; [`state`] remembers what is being recorded,
//! so that a logger that was killed goes on with the next part. The process around it is [`run`].

mod process;
pub mod queue;
pub mod sink;
pub mod state;
mod writer_thread;

pub use process::{Logger, LoggerError, Options, revision, run};
pub use writer_thread::Opener;

//! Every parser of what a user, a file or another process gives, listed once: for the fuzzers in
//! `tests/fuzz`, and for the test of this crate, which breaks the same seeds on a stable toolchain
//! in every test run.
//!
//! A [`Target`] reads bytes and checks what the parser promises: it returns a value or says in
//! words what is wrong; what is accepted and written again reads back as the same value. It panics
//! where a promise is broken. Seeds are shipped files, and files made by the project's own writers.
//! [`Target::broken`] breaks them with their structure in view, and makes checksums right again, so
//! that cases get past the door.
#![allow(clippy::expect_used, clippy::panic)]

mod changed_bytes;
mod json;
mod kept_files;
mod launched;
mod list;
mod mcap_file;
mod memory_file;
mod messages;
#[path = "../../common/mutated.rs"]
pub mod mutated;
mod mutation;
mod recordings;
mod requests;
mod tables;
mod texts;

pub use list::LIST;
pub use memory_file::MemoryFile;

use std::time::Duration;

use mutated::Numbers;
use rustix::time::{ClockId, clock_gettime};

/// Accepted, or why not, in words.
pub type Outcome = Result<(), String>;

/// How the bytes of a target are made up, for changes that keep them readable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// Lines of text, with `key = value` in some.
    Lines,
    /// JSON.
    Json,
    /// Nothing that a change could break.
    Bytes,
    /// As [`files::Format`] writes it: mark, version, checksum, bincode.
    Sealed,
    /// An MCAP file.
    Mcap,
}

/// A parser, with what it is tried on.
#[derive(Clone, Copy, Debug)]
pub struct Target {
    /// Its name, that of the fuzzer's program too.
    pub name: &'static str,
    /// What is read, and what is checked of it.
    pub about: &'static str,
    /// Form of the bytes, from [`Target::prefix`] on.
    pub form: Form,
    /// Bytes in front that choose a way to read the others.
    pub prefix: usize,
    /// Valid inputs, and some that are not.
    pub seeds: fn() -> Vec<Vec<u8>>,
    /// Longest input that is worth trying (bytes).
    pub longest: usize,
    read: fn(&[u8]) -> Outcome,
}

impl Target {
    /// The target of that name.
    pub fn of(name: &str) -> Option<&'static Self> {
        LIST.iter().find(|target| target.name == name)
    }

    /// Reads the bytes. Panics where a promise is broken.
    ///
    /// # Errors
    /// Why they are refused, in words.
    pub fn read(&self, bytes: &[u8]) -> Outcome {
        let outcome = (self.read)(bytes);
        if let Err(told) = &outcome {
            assert!(told.chars().any(char::is_alphabetic), "refused without a reason: {told:?}");
        }
        outcome
    }

    /// An input, broken with its structure in view; `others` are inputs to take parts from.
    pub fn broken(&self, bytes: &[u8], others: &[Vec<u8>], numbers: &mut Numbers) -> Vec<u8> {
        mutation::broken(self, bytes, others, numbers)
    }

    /// The bytes with their checksums made right, so that what is behind them is read.
    pub fn mended(&self, bytes: Vec<u8>) -> Vec<u8> {
        mutation::mended(self, bytes)
    }
}

/// Processor time of this thread so far: how long a case takes, whatever else the machine does.
pub fn processor_time() -> Duration {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    Duration::new(time.tv_sec.unsigned_abs(), time.tv_nsec.unsigned_abs() as u32)
}

/// The first byte as a choice among `count` ways, and the rest.
fn chosen(bytes: &[u8], count: usize) -> (usize, &[u8]) {
    match bytes.split_first() {
        Some((first, rest)) => (usize::from(*first) % count, rest),
        None => (0, bytes),
    }
}

/// Inputs with each of these bytes in front.
fn with_prefixes(prefixes: impl IntoIterator<Item = u8>, seeds: &[Vec<u8>]) -> Vec<Vec<u8>> {
    let with = |prefix| seeds.iter().map(move |seed| [&[prefix], seed.as_slice()].concat());
    prefixes.into_iter().flat_map(with).collect()
}

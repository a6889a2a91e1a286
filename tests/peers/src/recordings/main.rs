//! Writes a recording's messages anew with farreach's own writer or with the crate `mcap` alone,
//! and reads recordings with that crate: `.ci/measure.py peers` measures it beside farreach.
//!
//! ```text
//! recordings write WRITER SOURCE OUT     WRITER: farreach, mcap
//! recordings summary FILE                the end of the file alone
//! recordings read FILE                   every message, with the chunks' checksums
//! ```

mod write;

use std::fs::File;
use std::path::Path;
use std::process::ExitCode;

use mcap::read::Options;
use memmap2::Mmap;
use serde_json::{Value, json};

/// What went wrong, in words.
type Failure = Box<dyn std::error::Error>;

const USAGE: &str = "usage: recordings write farreach|mcap SOURCE OUT | recordings summary FILE | \
                     recordings read FILE";

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    let done = match words.as_slice() {
        ["write", writer, source, out] => write::again(writer, Path::new(source), Path::new(out)),
        ["summary", file] => summary(Path::new(file)),
        ["read", file] => read(Path::new(file)),
        _ => {
            eprintln!("{USAGE}");
            return ExitCode::from(2);
        }
    };
    match done {
        Ok(found) => {
            println!("{found}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("recordings {}: {error}", words.join(" "));
            ExitCode::FAILURE
        }
    }
}

/// A file as memory.
fn map(path: &Path) -> Result<Mmap, Failure> {
    let file = File::open(path).map_err(|error| format!("{}: {error}", path.display()))?;
    // SAFETY: nobody changes the recording while it is measured.
    Ok(unsafe { Mmap::map(&file) }?)
}

fn summary(path: &Path) -> Result<Value, Failure> {
    let bytes = map(path)?;
    let summary = mcap::Summary::read(&bytes)?.ok_or("it has no summary")?;
    let statistics = summary.stats.ok_or("its summary counts no messages")?;
    Ok(json!({
        "messages": statistics.message_count,
        "topics": summary.channels.len(),
        "seconds": (statistics.message_end_time - statistics.message_start_time) as f64 * 1e-9,
    }))
}

fn read(path: &Path) -> Result<Value, Failure> {
    let bytes = map(path)?;
    let options = Options::ValidateChunkCrcs.into();
    let (mut messages, mut payload) = (0_u64, 0);
    for message in mcap::MessageStream::new_with_options(&bytes, options)? {
        messages += 1;
        payload += message?.data.len();
    }
    Ok(json!({ "messages": messages, "payload_bytes": payload }))
}

//! Memory does not grow with the length of a recording. The allocator of this program counts; so it
//! has one test.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

use common::{Folder, long, rec};

struct Counting;

/// Bytes that are allocated, and the most since it was set.
static NOW: AtomicUsize = AtomicUsize::new(0);
static MOST: AtomicUsize = AtomicUsize::new(0);

fn more(bytes: usize) {
    let now = NOW.fetch_add(bytes, Ordering::Relaxed) + bytes;
    MOST.fetch_max(now, Ordering::Relaxed);
}

// SAFETY: the system's allocator does all of it; only sizes are counted.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        more(layout.size());
        // SAFETY: the caller's.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        NOW.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

/// What a command may hold more of the long recording: places of chunks, sessions, events, and how
/// far the threads happen to be ahead.
const MARGIN: usize = 8 << 20;

/// The most that is allocated while a command runs beyond what was before it (bytes).
fn most(words: &[&str]) -> usize {
    let before = NOW.load(Ordering::Relaxed);
    MOST.store(before, Ordering::Relaxed);
    let (code, text) = rec(words);
    assert_eq!(code, recorder::DONE, "{words:?}: {text}");
    // What it printed is not its own.
    (MOST.load(Ordering::Relaxed) - before).saturating_sub(2 * text.len())
}

#[test]
fn no_command_needs_more_memory_for_a_longer_recording() {
    let folder = Folder::new();
    for seconds in [5, 60] {
        long::write(&folder.path(&format!("{seconds}.mcap")), seconds);
    }
    let commands: [(&str, &[&str]); 11] = [
        ("info", &["info", "RUN"]),
        ("verify", &["verify", "RUN"]),
        ("record", &["export", "RUN", "--to", "csv", "-o", "OUT.csv"]),
        ("topic", &["export", "RUN", "--to", "csv", "--topic", "sample", "-o", "OUT.topic.csv"]),
        ("parquet", &["export", "RUN", "--to", "parquet", "-o", "OUT.parquet"]),
        (
            "topic, parquet",
            &["export", "RUN", "--to", "parquet", "--topic", "sample", "-o", "OUT.topic.parquet"],
        ),
        ("mat", &["export", "RUN", "--to", "mat", "-o", "OUT_"]),
        ("bids", &["export", "RUN", "--to", "bids", "-o", "OUT.bids"]),
        ("cut", &["cut", "RUN", "--from", "1", "-o", "OUT.cut.mcap"]),
        ("merge", &["merge", "RUN", "OUT.cut.mcap", "-o", "OUT.whole.mcap"]),
        ("recover", &["recover", "RUN", "-o", "OUT.recovered.mcap"]),
    ];
    let mut table = Vec::new();
    for (name, words) in commands {
        let [short, long] = [5, 60].map(|seconds| {
            let run = folder.text(&format!("{seconds}.mcap"));
            let out = folder.text(&format!("{seconds}"));
            let words: Vec<String> = words
                .iter()
                .map(|word| match *word {
                    "RUN" => run.clone(),
                    word => word.replace("OUT", &out),
                })
                .collect();
            most(&words.iter().map(String::as_str).collect::<Vec<_>>())
        });
        println!("{name}: {} KiB of 5 s, {} KiB of 60 s", short >> 10, long >> 10);
        table.push((name, short, long));
    }
    let samples = 60 * long::RATE_HZ as usize * size_of::<ipc_types::Sample>();
    assert!(samples > 5 * MARGIN, "a command that held the samples would not be noticed");
    for (name, short, long) in table {
        assert!(long <= short + MARGIN, "{name}: {short} bytes of 5 s, {long} of 60 s");
    }
}

//! The fuzzer of the target that bears this program's name. See `run.sh`.
#![no_main]

use std::sync::LazyLock;
use std::sync::atomic::{AtomicU64, Ordering};

use fuzz_targets::mutated::Numbers;
use fuzz_targets::{Target, processor_time};
use libfuzzer_sys::{fuzz_mutator, fuzz_target, fuzzer_mutate};

static TARGET: LazyLock<&'static Target> =
    LazyLock::new(|| Target::of(env!("CARGO_BIN_NAME")).expect("a target of the list"));
static SEEDS: LazyLock<Vec<Vec<u8>>> = LazyLock::new(|| (TARGET.seeds)());
/// Of all cases so far (µs).
static LONGEST: AtomicU64 = AtomicU64::new(0);

fuzz_target!(|bytes: &[u8]| {
    let started = processor_time();
    let _refused = TARGET.read(bytes);
    let took_us = processor_time().saturating_sub(started).as_micros() as u64;
    if took_us > LONGEST.fetch_max(took_us, Ordering::Relaxed) {
        println!("longest case so far: {took_us} us, {} bytes", bytes.len());
    }
});

// The first change of nothing is a seed. Half of the others are libFuzzer's own, with checksums
// made right; the rest know the structure.
fuzz_mutator!(|data: &mut [u8], size: usize, most: usize, seed: u32| {
    let mut numbers = Numbers(u64::from(seed) << 16 | 1);
    let most = most.min(TARGET.longest);
    let changed = if size <= 1 || numbers.below(100) == 0 {
        SEEDS[numbers.below(SEEDS.len())].clone()
    } else if numbers.below(2) == 0 {
        let size = fuzzer_mutate(data, size.min(most), most);
        match numbers.below(8) {
            0 => return size,
            _ => TARGET.mended(data[..size].to_vec()),
        }
    } else {
        TARGET.broken(&data[..size], &SEEDS, &mut numbers)
    };
    let size = changed.len().min(most);
    data[..size].copy_from_slice(&changed[..size]);
    size
});

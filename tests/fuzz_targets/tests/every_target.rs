//! Every target with some hundred broken inputs, the same each time: no promise is broken, and the
//! fuzzers of `tests/fuzz` still have something to work on.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::time::Duration;

use fuzz_targets::mutated::Numbers;
use fuzz_targets::{LIST, Target, processor_time};

/// Broken inputs of each target. `FARREACH_CASES` names another number.
const CASES: usize = 200;
/// Accepted inputs that are kept to be broken again.
const KEPT: usize = 200;

fn cases() -> usize {
    std::env::var("FARREACH_CASES").map_or(CASES, |text| text.parse().expect("a number"))
}

/// What came of the cases of a target.
#[derive(Debug, Default)]
struct Tally {
    accepted: usize,
    refused: usize,
    longest: Duration,
}

fn try_out(target: &Target, cases: usize) -> Tally {
    let mut inputs = (target.seeds)();
    let seeds = inputs.len();
    let mut numbers = Numbers(20_261_127);
    let mut tally = Tally::default();
    for _ in 0..cases {
        let input = &inputs[numbers.below(inputs.len())];
        let broken = target.broken(input, &inputs, &mut numbers);
        let started = processor_time();
        let outcome = target.read(&broken);
        tally.longest = tally.longest.max(processor_time().saturating_sub(started));
        match outcome {
            Ok(()) => {
                tally.accepted += 1;
                // What is accepted although it was broken is broken again.
                match inputs.len() {
                    length if length < seeds + KEPT => inputs.push(broken),
                    length => inputs[seeds + numbers.below(length - seeds)] = broken,
                }
            }
            Err(_) => tally.refused += 1,
        }
    }
    tally
}

#[test]
fn no_input_breaks_a_parser() {
    for target in LIST {
        let tally = try_out(target, cases());
        println!(
            "{:18} {:6} accepted {:6} refused, longest {:?}",
            target.name, tally.accepted, tally.refused, tally.longest
        );
        // Without either, the cases would mean nothing.
        assert!(tally.accepted > 0 && tally.refused > 0, "{}: {tally:?}", target.name);
    }
}

#[test]
fn every_target_accepts_a_seed() {
    for target in LIST {
        let seeds = (target.seeds)();
        let accepted = seeds.iter().filter(|seed| target.read(seed).is_ok()).count();
        let told: Vec<_> = seeds.iter().filter_map(|seed| target.read(seed).err()).collect();
        println!("{}: {accepted} of {} seeds accepted", target.name, seeds.len());
        assert!(accepted * 10 > seeds.len(), "{}: {told:#?}", target.name);
        let longest = seeds.iter().map(Vec::len).max().unwrap_or(0);
        assert!(longest <= target.longest, "{}: a seed of {longest} bytes", target.name);
    }
}

/// Each fuzzer is a target, and each target has one: the list of programs in `tests/fuzz` is the
/// list of targets.
#[test]
fn every_target_has_a_fuzzer() {
    let manifest = include_str!("../../fuzz/Cargo.toml");
    let fuzzers: Vec<&str> = manifest
        .split("[[bin]]")
        .skip(1)
        .filter_map(|entry| entry.split_once("name = \"")?.1.split_once('"'))
        .map(|(name, _)| name)
        .collect();
    let targets: Vec<&str> = LIST.iter().map(|target| target.name).collect();
    assert_eq!(fuzzers, targets);
}

//! Random numbers: all that a case draws follow from its seed.

use rand::{Rng as _, RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use rand_xoshiro::SplitMix64;

/// A stream of random numbers.
#[derive(Clone, Debug)]
pub struct Draw(Pcg64);

impl Draw {
    /// The stream of a seed.
    pub fn new(seed: u64) -> Self {
        Self(Pcg64::seed_from_u64(seed))
    }

    /// Uniform between two bounds.
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.0.random::<f64>()
    }

    /// Log-uniform between two positive bounds.
    pub fn log_uniform(&mut self, low: f64, high: f64) -> f64 {
        self.uniform(low.ln(), high.ln()).exp()
    }

    /// Standard normal.
    pub fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }

    /// Plus or minus one.
    pub fn sign(&mut self) -> f64 {
        if self.0.random::<bool>() { 1.0 } else { -1.0 }
    }

    /// An angle between -π and π.
    pub fn phase(&mut self) -> f64 {
        self.uniform(-std::f64::consts::PI, std::f64::consts::PI)
    }

    /// An element of a list; the default of its type if the list is empty.
    pub fn choose<T: Copy + Default>(&mut self, from: &[T]) -> T {
        from.get(self.below(from.len())).copied().unwrap_or_default()
    }

    /// An integer below `count`; 0 if that is 0.
    pub fn below(&mut self, count: usize) -> usize {
        if count == 0 { 0 } else { self.0.random_range(0..count) }
    }
}

/// A seed of its own for a part of a case: the same for the same seed and part, and unlike its
/// neighbours (splitmix64).
pub fn subseed(seed: u64, part: &str) -> u64 {
    part.bytes().fold(mix(seed), |mixed, byte| mix(mixed ^ u64::from(byte)))
}

fn mix(seed: u64) -> u64 {
    SplitMix64::seed_from_u64(seed).next_u64()
}

//! A scanner whose pulses jitter, are missing, or too many.

use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;

use super::ScannerTrigger;
use super::trigger::EDGE_S;
use crate::ParameterError;

/// What is wrong with a scanner's pulses; nothing by default.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriggerFaults {
    /// Standard deviation of the start of a pulse (s); it stays within three of them.
    pub jitter_s: f64,
    /// Volumes without a pulse, from 0.
    pub missing: Vec<u64>,
    /// Starts of pulses that belong to no volume (s).
    pub spurious_s: Vec<f64>,
    /// Seed of the jitter: the same seed gives the same.
    pub seed: u64,
}

/// The trigger output of a scanner with faults. Its time is an argument, in any order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ScannerEmulator {
    /// The scanner without faults.
    pub trigger: ScannerTrigger,
    /// Its faults.
    pub faults: TriggerFaults,
}

/// A pulse starts within this multiple of the jitter from the start of its volume.
const FURTHEST: f64 = 3.0;
/// Volumes among which the next pulse is, where none is missing.
const CANDIDATES: usize = 4;

impl ScannerEmulator {
    /// Checks the trigger, and that its jitter lets no two pulses meet.
    ///
    /// # Errors
    /// [`ParameterError::OutOfRange`].
    pub fn checked(self) -> Result<Self, ParameterError> {
        self.trigger.checked()?;
        let (maximum, value) = (Self::jitter_limit_s(&self.trigger), self.faults.jitter_s);
        if !(0.0..=maximum).contains(&value) {
            let (name, unit) = ("jitter_s", "s");
            return Err(ParameterError::OutOfRange { name, value, minimum: 0.0, maximum, unit });
        }
        Ok(self)
    }

    /// Largest jitter with which no two pulses meet (s).
    pub fn jitter_limit_s(trigger: &ScannerTrigger) -> f64 {
        (trigger.repetition_s - trigger.pulse_s) / (2.0 * FURTHEST + 1.0)
    }

    /// Start of the pulse of a volume (s); `None` where it is missing, or beyond the last volume.
    pub fn pulse_start_s(&self, volume: u64) -> Option<f64> {
        let trigger = &self.trigger;
        let beyond = trigger.volumes != 0.0 && volume as f64 >= trigger.volumes;
        if beyond || self.faults.missing.contains(&volume) {
            return None;
        }
        let due_s = trigger.start_s + volume as f64 * trigger.repetition_s;
        if self.faults.jitter_s == 0.0 {
            return Some(due_s);
        }
        let seed = self.faults.seed ^ volume.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let normal: f64 = StandardNormal.sample(&mut Pcg64Mcg::seed_from_u64(seed));
        Some(due_s + self.faults.jitter_s * normal.clamp(-FURTHEST, FURTHEST))
    }

    /// Start of the first pulse after a time (s), of a volume or spurious; `None` after the last.
    pub fn next_pulse_s(&self, after_s: f64) -> Option<f64> {
        let trigger = &self.trigger;
        let early = FURTHEST * self.faults.jitter_s;
        let first = ((after_s - early - trigger.start_s) / trigger.repetition_s).max(0.0) as u64;
        // Pulses of volumes come in their order, as no two meet; one of these has come already.
        let candidates = CANDIDATES + self.faults.missing.len();
        let of_volume = (first..)
            .take(candidates)
            .filter_map(|volume| self.pulse_start_s(volume))
            .find(|start_s| *start_s > after_s);
        let spurious = self.faults.spurious_s.iter().copied().filter(|start_s| *start_s > after_s);
        of_volume.into_iter().chain(spurious).min_by(f64::total_cmp)
    }

    /// Whether a pulse is active; its start is included, its end is not.
    pub fn pulse(&self, time_s: f64) -> bool {
        let time_s = time_s + EDGE_S;
        let active = |start_s: f64| (start_s..start_s + self.trigger.pulse_s).contains(&time_s);
        // A pulse may come early, and so before its volume begins.
        let early = FURTHEST * self.faults.jitter_s;
        let newest = (time_s + early - self.trigger.start_s) / self.trigger.repetition_s;
        let of_volume = newest >= 0.0
            && [newest as u64, (newest as u64).saturating_sub(1)]
                .iter()
                .any(|volume| self.pulse_start_s(*volume).is_some_and(active));
        of_volume || self.faults.spurious_s.iter().any(|start_s| active(*start_s))
    }

    /// Voltage of the line, V.
    pub fn volts(&self, time_s: f64) -> f64 {
        if self.pulse(time_s) { self.trigger.pulse_v } else { self.trigger.idle_v }
    }
}

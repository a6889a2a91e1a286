//! Supervision of the program flow: a loop folds the checkpoints of its cycle into a signature,
//! and the watchdog compares it with that of the cycle as it should be.
//!
//! The signature depends on which checkpoints were passed, in which order, and on the newest token
//! that the loop saw: one that is repeated, or made without running the cycle, does not match.
//!
//! ```
//! use ipc_types::program_flow::{CONTROL_CYCLE, Checkpoint, Flow, signature};
//!
//! let mut flow = Flow::default();
//! flow.pass(Checkpoint::SampleTaken);
//! flow.pass(Checkpoint::SetpointsTaken);
//! flow.pass(Checkpoint::TokenTaken);
//! flow.pass(Checkpoint::LawStepped);
//! assert_eq!(flow.signature(17), signature(CONTROL_CYCLE, 17));
//! assert_ne!(flow.signature(18), signature(CONTROL_CYCLE, 17));
//! ```

/// A step of a loop's cycle. The code is what is folded into the signature.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Checkpoint {
    /// Acquisition has taken every token.
    TokensTaken = 1,
    /// Acquisition has taken every command.
    CommandsTaken = 2,
    /// The gate has decided.
    GateStepped = 3,
    /// The card has the gate's volts.
    VoltsWritten = 4,
    /// A scan is converted.
    ScanConverted = 5,
    /// Control has looked for a newer sample.
    SampleTaken = 16,
    /// Control has checked every setpoint.
    SetpointsTaken = 17,
    /// Control has looked for a newer token.
    TokenTaken = 18,
    /// The law has computed volts.
    LawStepped = 19,
}

/// Checkpoints of each sample, in order.
pub const ACQUISITION_CYCLE: &[Checkpoint] = &[
    Checkpoint::TokensTaken,
    Checkpoint::CommandsTaken,
    Checkpoint::GateStepped,
    Checkpoint::VoltsWritten,
    Checkpoint::ScanConverted,
];

/// Checkpoints of each command, in order.
pub const CONTROL_CYCLE: &[Checkpoint] = &[
    Checkpoint::SampleTaken,
    Checkpoint::SetpointsTaken,
    Checkpoint::TokenTaken,
    Checkpoint::LawStepped,
];

/// Offset basis and prime of the 32-bit FNV-1a hash.
const BASIS: u32 = 0x811c_9dc5;
const PRIME: u32 = 0x0100_0193;

/// The checkpoints of one cycle, folded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Flow(u32);

impl Default for Flow {
    /// No checkpoint yet: the beginning of a cycle.
    fn default() -> Self {
        Self(BASIS)
    }
}

impl Flow {
    /// Passes a checkpoint: FNV-1a of its code.
    pub const fn pass(&mut self, checkpoint: Checkpoint) {
        self.fold(checkpoint as u8);
    }

    const fn fold(&mut self, byte: u8) {
        self.0 = (self.0 ^ byte as u32).wrapping_mul(PRIME);
    }

    /// The signature for a challenge, the sequence of the newest token: FNV-1a of the checkpoints'
    /// codes and the challenge's eight bytes, lowest first, its two halves combined by exclusive
    /// or.
    pub const fn signature(mut self, challenge: u64) -> u16 {
        let bytes = challenge.to_le_bytes();
        let mut at = 0;
        while at < bytes.len() {
            self.fold(bytes[at]);
            at += 1;
        }
        (self.0 >> 16) as u16 ^ self.0 as u16
    }
}

/// Signature of a cycle that passes exactly these checkpoints.
pub const fn signature(cycle: &[Checkpoint], challenge: u64) -> u16 {
    let mut flow = Flow(BASIS);
    let mut at = 0;
    while at < cycle.len() {
        flow.pass(cycle[at]);
        at += 1;
    }
    flow.signature(challenge)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_left_out_doubled_or_swapped_shows_within_a_few_cycles() {
        for cycle in [ACQUISITION_CYCLE, CONTROL_CYCLE] {
            let mut wrong = vec![Vec::new(), [cycle, cycle].concat()];
            for at in 0..cycle.len() {
                let mut without = cycle.to_vec();
                let step = without.remove(at);
                wrong.push(without);
                let mut doubled = cycle.to_vec();
                doubled.insert(at, step);
                wrong.push(doubled);
                if at > 0 {
                    let mut swapped = cycle.to_vec();
                    swapped.swap(at - 1, at);
                    wrong.push(swapped);
                }
            }
            for checkpoints in wrong {
                // 16 bits agree by chance once in 65,536 cycles, and not in two that follow.
                let missed = (1000..1100)
                    .filter(|&token| signature(&checkpoints, token) == signature(cycle, token))
                    .count();
                assert!(missed <= 1, "{checkpoints:?}: {missed} of 100");
            }
        }
    }

    #[test]
    fn a_repeated_signature_does_not_answer_the_next_token() {
        for token in 0..1000 {
            let (now, next) =
                (signature(CONTROL_CYCLE, token), signature(CONTROL_CYCLE, token + 1));
            assert_ne!(now, next, "token {token}");
        }
    }

    #[test]
    fn the_signature_is_that_of_the_published_recipe() {
        // Computed by another program from the recipe: values for a program in another language to
        // check itself against.
        assert_eq!(signature(CONTROL_CYCLE, 0), 0xe9f5);
        assert_eq!(signature(ACQUISITION_CYCLE, 1_000_000), 0x4c8d);
    }
}

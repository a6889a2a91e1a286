//! The acquisition process: card to shared memory, with the gate.

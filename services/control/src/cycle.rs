//! One cycle of control, from what was received to the command. Pure: time and messages are
//! arguments. The process runs it, and `farreach rec resim` runs it again on a recording.

use ipc_types::{EnableToken, GateState, MotorCommand, Sample, Setpoint};

use crate::law::Law;

/// What control has when it computes a command.
#[derive(Clone, Copy, Debug)]
pub struct Seen<'a> {
    /// The newest sample.
    pub sample: &'a Sample,
    /// The setpoint that it holds, followed or not.
    pub setpoint: Option<&'a Setpoint>,
    /// The newest token.
    pub token: Option<&'a EnableToken>,
    /// Incarnation of this control.
    pub incarnation: u64,
}

impl Seen<'_> {
    /// Whether the gate is open for the epoch of the newest token, and for commands of this
    /// process.
    pub fn powered(&self) -> bool {
        self.token.is_some_and(|token| {
            token.enabled == 1
                && token.control_incarnation == self.incarnation
                && self.sample.epoch == token.epoch
                && self.sample.gate_state == GateState::Open.code()
        })
    }

    /// Computes the command, with all that says from what. The loop adds identity, `flow`,
    /// `cycles_missed` and `profile`.
    pub fn step(&self, law: &mut Law, now_ns: u64) -> MotorCommand {
        let mut command = law.step(now_ns, self.sample, self.setpoint, self.powered());
        if let Some(token) = self.token {
            command.token_sequence = token.sequence;
            command.epoch = token.epoch;
        }
        if let Some(held) = self.setpoint {
            command.held_incarnation = held.incarnation;
            command.held_sequence = held.sequence;
        }
        command
    }
}

//! A gate beside its oracle.

use ipc_types::{AXES, EnableToken, GateState, MotorCommand};
use runtime::gate::{Gate, GateConfig};

use crate::oracle::{Oracle, within_limits};
use crate::{START, config};

/// One thing that may happen in front of a gate.
#[derive(Clone, Debug)]
pub(crate) enum Act {
    /// Its times count from now, its sequence from the last one, and its epoch from that of
    /// `NextEpoch`.
    Token(EnableToken),
    /// As the token, and the tick of its sample from the last one; the time of its sample counts
    /// backwards.
    Command(MotorCommand),
    NextEpoch,
    /// A cycle, so many ns after the last.
    Step(i64),
    WriteFailed,
}

/// A gate, its oracle, and what both have shown so far.
#[derive(Clone)]
pub(crate) struct Checked {
    config: GateConfig,
    gate: Gate,
    oracle: Oracle,
    now: u64,
    /// Sequences of the last token and command.
    sequences: [u64; 2],
    sample_tick: u64,
    /// What the epochs of tokens count from.
    base_epoch: u64,
    /// Highest epoch that has ended.
    ended: u64,
    last_state: GateState,
    last_epoch: u64,
    stepped: bool,
    /// Whether the card has refused a write of a gate that waits since the last cycle.
    refused: bool,
}

impl Checked {
    pub(crate) fn new() -> Self {
        let config = config();
        Self {
            config,
            gate: Gate::new(config),
            oracle: Oracle::new(config),
            now: START,
            sequences: [100; 2],
            sample_tick: 1_000,
            base_epoch: 0,
            ended: 0,
            last_state: GateState::Closed,
            last_epoch: 0,
            stepped: false,
            refused: false,
        }
    }

    /// State after the last cycle.
    pub(crate) fn state(&self) -> GateState {
        self.last_state
    }

    /// Lets something happen; an error says what the gate did and must not do: volts other than 0
    /// without the oracle's consent, beyond the limits, or for an epoch that was ended.
    pub(crate) fn act(&mut self, act: &Act) -> Result<(), String> {
        match act {
            Act::Token(token) => {
                self.sequences[0] = self.sequences[0].wrapping_add(token.sequence);
                let issued_ns = self.now.wrapping_add(token.issued_ns);
                let token = EnableToken {
                    sequence: self.sequences[0],
                    issued_ns,
                    time_ns: issued_ns,
                    valid_until_ns: issued_ns.saturating_add(token.valid_until_ns),
                    epoch: self.base_epoch + token.epoch,
                    ..*token
                };
                self.oracle.hear_token(&token);
                self.gate.observe_token(&token);
            }
            Act::Command(command) => {
                self.sequences[1] = self.sequences[1].wrapping_add(command.sequence);
                self.sample_tick = self.sample_tick.wrapping_add(command.sample_tick);
                let computed_ns = self.now.wrapping_add(command.computed_ns);
                let command = MotorCommand {
                    sequence: self.sequences[1],
                    computed_ns,
                    time_ns: computed_ns,
                    sample_tick: self.sample_tick,
                    sample_time_ns: self.now.wrapping_sub(command.sample_time_ns),
                    ..*command
                };
                self.oracle.hear_command(&command);
                self.gate.observe_command(&command);
            }
            Act::NextEpoch => self.base_epoch += 1,
            Act::WriteFailed => {
                let output = self.gate.write_failed();
                if output.state == GateState::Open || output.volts != [0.0; AXES] {
                    return Err(format!("{output:?} after a refused write"));
                }
                // An open gate's epoch ends, at once; a higher one may open in the next cycle.
                if self.last_state == GateState::Open {
                    self.ended = self.ended.max(self.last_epoch);
                } else {
                    self.refused = true;
                }
                self.oracle.became(false);
            }
            Act::Step(by) => return self.step(*by),
        }
        Ok(())
    }

    fn step(&mut self, by: i64) -> Result<(), String> {
        self.now = self.now.wrapping_add(by as u64);
        let output = self.gate.step(self.now);
        if !within_limits(&output.volts) {
            return Err(format!("{:?} V", output.volts));
        }
        let open = output.state == GateState::Open;
        if open {
            let epoch = self.oracle.epoch();
            // The first step knows of no time before it.
            let in_time = u64::try_from(by).is_ok_and(|by| by <= self.config.max_cycle_gap_ns);
            if self.stepped && !in_time {
                return Err(format!("open {by} ns after the last cycle"));
            }
            if self.refused {
                return Err("open in the cycle after a refused write".to_owned());
            }
            if epoch <= self.ended {
                return Err(format!("open for {epoch}, ended up to {}", self.ended));
            }
            self.oracle.allows(self.now, output.volts)?;
            self.last_epoch = epoch;
        } else {
            if output.volts != [0.0; AXES] {
                return Err(format!("closed with {:?} V", output.volts));
            }
            if self.last_state == GateState::Open {
                self.ended = self.ended.max(self.last_epoch);
            }
        }
        self.oracle.became(open);
        (self.last_state, self.stepped, self.refused) = (output.state, true, false);
        Ok(())
    }
}

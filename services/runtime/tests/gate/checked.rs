//! A gate beside a slow oracle that judges from the whole history what may pass.

use ipc_types::{AXES, EnableToken, GateState, MotorCommand};
use runtime::gate::{Gate, GateConfig};

use crate::{START, config};

/// One thing that may happen in front of a gate.
#[derive(Clone, Debug)]
pub(crate) enum Act {
    /// Its times count from now, and its sequence from the last one.
    Token(EnableToken),
    /// As the token; the time of its sample counts backwards.
    Command(MotorCommand),
    /// A cycle, so many ns after the last.
    Step(i64),
    WriteFailed,
}

/// What the slow oracle keeps: everything that ever arrived, in order.
#[derive(Clone, Default)]
struct Oracle {
    tokens: Vec<EnableToken>,
    commands: Vec<MotorCommand>,
}

impl Oracle {
    /// Whether these volts may be written now, judged from the whole history.
    fn allows(
        &self,
        config: &GateConfig,
        now: u64,
        volts: [f64; AXES],
    ) -> Result<(), &'static str> {
        let ensure = |holds: bool, what: &'static str| if holds { Ok(()) } else { Err(what) };
        let token = self.tokens.last().ok_or("no token")?;
        let command = self.commands.last().ok_or("no command")?;
        ensure(command.volts == volts, "not the newest command's volts")?;
        ensure(token.session == config.session && command.session == config.session, "session")?;
        ensure(token.enabled == 1, "not enabled")?;
        ensure(token.incarnation == token.watchdog_incarnation, "token's sender")?;
        ensure(
            token.acquisition_incarnation == config.acquisition_incarnation,
            "token's receiver",
        )?;
        ensure(token.control_incarnation == command.incarnation, "command's sender")?;
        let age = |then: u64| i128::from(now) - i128::from(then);
        let future = -i128::from(config.future_ns);
        ensure(
            age(token.issued_ns) >= future && age(token.time_ns) >= future,
            "token from the future",
        )?;
        ensure(age(token.issued_ns) <= i128::from(config.token_life_ns), "token too old")?;
        ensure(age(token.valid_until_ns) <= 0, "token expired")?;
        let life = i128::from(token.valid_until_ns) - i128::from(token.issued_ns);
        ensure((0..=i128::from(config.token_life_ns)).contains(&life), "token's life")?;
        ensure(
            age(command.computed_ns) >= future && age(command.time_ns) >= future,
            "command from the future",
        )?;
        ensure(age(command.computed_ns) <= i128::from(config.command_life_ns), "command too old")?;
        let sample_age = age(command.sample_time_ns);
        ensure(
            sample_age >= future && sample_age <= i128::from(config.max_sample_age_ns),
            "sample's age",
        )?;
        let withdrawn = |earlier: &EnableToken| {
            earlier.enabled != 1
                && earlier.session == config.session
                && earlier.incarnation == earlier.watchdog_incarnation
                && earlier.epoch >= token.epoch
        };
        ensure(!self.tokens.iter().any(withdrawn), "withdrawn before")?;
        // In sequence: nothing of the same sender that came before has a higher or the same number
        // (but the same message again), within this session.
        let earlier = &self.tokens[..self.tokens.len() - 1];
        ensure(
            !earlier.iter().rev().take_while(|t| t.epoch == token.epoch && *t != token).any(|t| {
                t.session == token.session
                    && t.incarnation == token.incarnation
                    && t.sequence >= token.sequence
            }),
            "token out of sequence",
        )
    }
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
    /// Highest epoch that has ended.
    ended: u64,
    last_state: GateState,
    last_epoch: u64,
    stepped: bool,
}

impl Checked {
    pub(crate) fn new() -> Self {
        let config = config();
        Self {
            config,
            gate: Gate::new(config),
            oracle: Oracle::default(),
            now: START,
            sequences: [100; 2],
            ended: 0,
            last_state: GateState::Closed,
            last_epoch: 0,
            stepped: false,
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
                self.sequences[0] += token.sequence;
                let issued_ns = self.now.wrapping_add(token.issued_ns);
                let token = EnableToken {
                    sequence: self.sequences[0],
                    issued_ns,
                    time_ns: issued_ns,
                    valid_until_ns: issued_ns.saturating_add(token.valid_until_ns),
                    ..*token
                };
                self.oracle.tokens.push(token);
                self.gate.observe_token(&token);
            }
            Act::Command(command) => {
                self.sequences[1] += command.sequence;
                let computed_ns = self.now.wrapping_add(command.computed_ns);
                let command = MotorCommand {
                    sequence: self.sequences[1],
                    computed_ns,
                    time_ns: computed_ns,
                    sample_time_ns: self.now.wrapping_sub(command.sample_time_ns),
                    ..*command
                };
                self.oracle.commands.push(command);
                self.gate.observe_command(&command);
            }
            Act::WriteFailed => {
                self.gate.write_failed();
                if self.last_state == GateState::Open {
                    self.ended = self.ended.max(self.last_epoch);
                }
            }
            Act::Step(by) => return self.step(*by),
        }
        Ok(())
    }

    fn step(&mut self, by: i64) -> Result<(), String> {
        self.now = self.now.wrapping_add(by as u64);
        let output = self.gate.step(self.now);
        for (volts, limit) in output.volts.iter().zip([5.0, 3.0, 0.0]) {
            if !(volts.is_finite() && volts.abs() <= limit) {
                return Err(format!("{:?} V", output.volts));
            }
        }
        if output.state == GateState::Open {
            let epoch = self.oracle.tokens.last().map_or(0, |token| token.epoch);
            // The first step knows of no time before it.
            if by < 0 && self.stepped {
                return Err("open although time went backwards".to_owned());
            }
            if epoch <= self.ended {
                return Err(format!("open for {epoch}, ended up to {}", self.ended));
            }
            self.oracle.allows(&self.config, self.now, output.volts)?;
            self.last_epoch = epoch;
        } else {
            if output.volts != [0.0; AXES] {
                return Err(format!("closed with {:?} V", output.volts));
            }
            if self.last_state == GateState::Open {
                self.ended = self.ended.max(self.last_epoch);
            }
        }
        (self.last_state, self.stepped) = (output.state, true);
        Ok(())
    }
}

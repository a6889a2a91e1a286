//! Every sequence of a few events, held against the oracle: bounded model checking of the gate.
//!
//! The events are those that tell cases of its code apart: each sender and receiver right and
//! wrong, each sequence rising and repeated, each age within and beyond its limit, each epoch, and
//! the values that a command may not have. `FARREACH_DEPTH` asks for longer sequences than the
//! usual ones.

use ipc_types::{EnableToken, GateState, MotorCommand};

use crate::checked::{Act, Checked};
use crate::walk::{Judged, depth, every_sequence};
use crate::{ACQUISITION, CONTROL, CYCLE, MS, SESSION, WATCHDOG};

/// Length of the sequences.
const DEPTH: usize = 4;

fn good_token() -> EnableToken {
    EnableToken {
        session: SESSION,
        incarnation: WATCHDOG,
        watchdog_incarnation: WATCHDOG,
        acquisition_incarnation: ACQUISITION,
        control_incarnation: CONTROL,
        sequence: 1,
        valid_until_ns: 5 * MS,
        epoch: 1,
        enabled: 1,
        ..EnableToken::default()
    }
}

fn good_command() -> MotorCommand {
    MotorCommand {
        session: SESSION,
        incarnation: CONTROL,
        sequence: 1,
        sample_time_ns: CYCLE,
        volts: [1.5, -2.0, 0.0],
        ..MotorCommand::default()
    }
}

/// Events that may come in any order.
fn events() -> Vec<(&'static str, Act)> {
    let token = |name, token| (name, Act::Token(token));
    let command = |name, command| (name, Act::Command(command));
    let (good, fine) = (good_token(), good_command());
    let ms = MS as i64;
    vec![
        token("token", good),
        token("token of the next epoch", EnableToken { epoch: 2, ..good }),
        token("withdrawal", EnableToken { enabled: 0, ..good }),
        token("token again in sequence", EnableToken { sequence: 0, ..good }),
        token("token of another session", EnableToken { session: 12, ..good }),
        token(
            "token of another watchdog",
            EnableToken { incarnation: 32, watchdog_incarnation: 32, ..good },
        ),
        token("forged token", EnableToken { incarnation: 33, ..good }),
        token("token for another acquisition", EnableToken { acquisition_incarnation: 22, ..good }),
        token("token for another control", EnableToken { control_incarnation: 42, ..good }),
        token("old token", EnableToken { issued_ns: (-6 * ms) as u64, ..good }),
        token("token from the future", EnableToken { issued_ns: 2 * MS, ..good }),
        token("token that lasts too long", EnableToken { valid_until_ns: 6 * MS, ..good }),
        command("command", fine),
        command("command again in sequence", MotorCommand { sequence: 0, ..fine }),
        command("command of another session", MotorCommand { session: 12, ..fine }),
        command("command of another control", MotorCommand { incarnation: 42, ..fine }),
        command("old command", MotorCommand { computed_ns: (-6 * ms) as u64, ..fine }),
        command("command from the future", MotorCommand { computed_ns: 2 * MS, ..fine }),
        command("command of an old sample", MotorCommand { sample_time_ns: 11 * MS, ..fine }),
        command("command beyond the limit", MotorCommand { volts: [5.1, 0.0, 0.0], ..fine }),
        command("command for no axis", MotorCommand { volts: [0.0, 0.0, 0.1], ..fine }),
        command("command that is no number", MotorCommand { volts: [f64::NAN; 3], ..fine }),
        ("step", Act::Step(CYCLE as i64)),
        ("late step", Act::Step(6 * ms)),
        ("step back in time", Act::Step(-ms)),
        ("write failed", Act::WriteFailed),
    ]
}

impl Judged for Checked {
    type Event = (&'static str, Act);

    fn name(event: &Self::Event) -> String {
        event.0.to_owned()
    }

    fn perform(&mut self, event: &Self::Event) -> Result<(), String> {
        self.act(&event.1)
    }

    fn end(&mut self) -> Result<bool, String> {
        self.act(&Act::Step(CYCLE as i64))?;
        Ok(self.state() == GateState::Open)
    }
}

#[test]
fn sr_10_every_sequence_of_events_from_a_new_and_from_an_open_gate() {
    let depth = depth(DEPTH);
    let events = events();
    let new = Checked::new();
    let mut open = new.clone();
    for act in [Act::Token(good_token()), Act::Command(good_command()), Act::Step(CYCLE as i64)] {
        open.act(&act).unwrap();
    }
    assert_eq!(open.state(), GateState::Open);
    for (name, from, opens) in [("new", new, false), ("open", open, true)] {
        let walk = every_sequence(&from, &events, depth);
        println!("from a {name} gate: {} sequences, {} open", walk.sequences, walk.powered);
        // The walk tries what it is for: from both, some sequences end with volts and most without.
        assert!(walk.powered > 0 && walk.powered < walk.sequences / if opens { 2 } else { 10 });
    }
}

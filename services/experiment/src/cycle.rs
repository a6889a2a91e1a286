//! One cycle of the experiment, from what was received to the setpoint, and what it does with what
//! it receives. Pure: time and messages are arguments. The process runs it, and `farreach rec
//! resim` runs it again on a recording.

use std::sync::Arc;

use ipc_types::{
    AXES, EnableToken, GateState, LineEvent, Sample, ScannerPulse, Setpoint, WatchdogState, Zeros,
};

use crate::ilc_trial::IlcResult;
use crate::player::{LEASE_NS, Output, Permission, Player, Program};

/// Most reports on the scan that are taken from the player in a cycle, so that no subscriber's
/// buffer runs over; the others wait for the next. The player follows no more of the scan than it
/// has room for reports.
pub const SCAN_REPORTS_A_CYCLE: usize = 16;

/// What the experiment has received since it started; setpoints tell it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Received {
    /// How many samples.
    pub samples: u64,
    /// Sender of the newest event of the scanner's line; 0 before the first.
    pub pulse_incarnation: u64,
    /// Sequence of that event.
    pub pulse_sequence: u64,
    /// How many events of the scanner's line.
    pub pulses: u64,
    /// How many pulses that were typed as the key 5.
    pub keys: u64,
    /// How many results of learning.
    pub results: u64,
    /// Number of the newest order.
    pub order: u32,
    /// Number of the order to play that was carried out last; 0 before the first.
    pub run: u32,
}

impl Received {
    /// What a setpoint tells.
    pub const fn of(setpoint: &Setpoint) -> Self {
        Self {
            samples: setpoint.samples_received,
            pulse_incarnation: setpoint.pulse_incarnation,
            pulse_sequence: setpoint.pulse_sequence,
            pulses: setpoint.pulses_received,
            keys: setpoint.keys_received,
            results: setpoint.results_received,
            order: setpoint.order,
            run: setpoint.run,
        }
    }

    /// Hands a sample to the player.
    pub fn sample(&mut self, sample: &Sample, player: &mut Player) {
        self.samples += 1;
        let powered = sample.gate_state == GateState::Open.code();
        player.record(sample.scan_time_ns, &handles(Some(sample)), powered);
    }

    /// Hands an event of the scanner's line to the player.
    pub fn pulse(&mut self, pulse: &ScannerPulse, player: &mut Player) {
        self.pulses += 1;
        (self.pulse_incarnation, self.pulse_sequence) = (pulse.incarnation, pulse.sequence);
        if let Some(event) = LineEvent::from_code(pulse.kind) {
            player.see_scanner(event, pulse.at_ns);
        }
    }

    /// Hands a pulse that was typed as the key 5 at `at_ns` (CLOCK_MONOTONIC) to the player.
    pub fn key(&mut self, at_ns: u64, player: &mut Player) {
        self.keys += 1;
        player.see_scanner_key(at_ns);
    }

    /// Hands a result of learning to the player.
    pub fn result(&mut self, result: IlcResult, player: &mut Player) {
        self.results += 1;
        player.receive(result);
    }

    /// Has the player play a program in an enable `epoch`, by the order of that number.
    pub fn play(&mut self, number: u32, program: Arc<Program>, epoch: u64, player: &mut Player) {
        player.start(program, epoch);
        (self.order, self.run) = (number, number);
    }

    /// Has the player stop, by the order of that number.
    pub fn stop(&mut self, number: u32, player: &mut Player) {
        player.stop();
        self.order = number;
    }
}

/// What the experiment has when it computes a setpoint.
#[derive(Clone, Copy, Debug)]
pub struct Seen<'a> {
    /// The newest sample.
    pub sample: Option<&'a Sample>,
    /// The newest token.
    pub token: Option<&'a EnableToken>,
    /// When the client last renewed its lease (ns, CLOCK_MONOTONIC); 0: not yet.
    pub renewed_ns: u64,
    /// What was received so far.
    pub received: Received,
}

impl Seen<'_> {
    /// The watchdog's permission at `now_ns` (CLOCK_MONOTONIC); withdrawn if its token is stale, as
    /// the gate is closed by then.
    pub fn permission(&self, now_ns: u64) -> Permission {
        let Some(token) = self.token else { return Permission::Unknown };
        let age_ns = now_ns.saturating_sub(token.time_ns);
        if token.state == WatchdogState::Enabled.code() && age_ns <= LEASE_NS {
            Permission::Enabled(token.epoch)
        } else {
            Permission::Withdrawn
        }
    }

    /// Runs the player's cycle at `now_ns` (CLOCK_MONOTONIC); the setpoint has all that says from
    /// what it was computed, and the publisher adds the identity. `None` where no step is due:
    /// without samples the handle's position is unknown, so no setpoint is published, the lease
    /// lapses and control ramps to hold. When samples return, the segment starts again from where
    /// the handle then is. A stop is always carried out.
    pub fn step(&self, player: &mut Player, now_ns: u64) -> Option<Output> {
        player.supervise(now_ns, self.permission(now_ns), self.renewed_ns);
        let sample_ns = self.sample.map_or(0, |sample| sample.time_ns);
        let fresh = now_ns.saturating_sub(sample_ns) <= LEASE_NS;
        if !fresh && !player.is_ending() {
            return None;
        }
        let sample = self.sample.filter(|_| fresh);
        player.see_handles(handles(sample));
        player.see_zeros(sample.map(Zeros::from));
        let mut output = player.step(now_ns, &measured(sample));
        if let Some(setpoint) = &mut output.setpoint {
            self.name(setpoint, player, now_ns);
        }
        Some(output)
    }

    /// Says in a setpoint from what it was computed.
    fn name(&self, setpoint: &mut Setpoint, player: &Player, now_ns: u64) {
        setpoint.player_ns = now_ns;
        if let Some(sample) = self.sample {
            (setpoint.sample_tick, setpoint.sample_time_ns) = (sample.tick, sample.scan_time_ns);
        }
        if let Some(token) = self.token {
            setpoint.token_incarnation = token.incarnation;
            setpoint.token_sequence = token.sequence;
        }
        let received = &self.received;
        setpoint.samples_received = received.samples;
        setpoint.pulse_incarnation = received.pulse_incarnation;
        setpoint.pulse_sequence = received.pulse_sequence;
        setpoint.pulses_received = received.pulses;
        setpoint.keys_received = received.keys;
        setpoint.results_received = received.results;
        (setpoint.order, setpoint.run) = (received.order, received.run);
        setpoint.renewed_ns = self.renewed_ns;
        setpoint.run_ns = player.supervised_since_ns();
        setpoint.epoch = player.epoch();
        let continued = player.program().is_some_and(|program| program.continues().is_some());
        setpoint.continued = u8::from(continued);
    }
}

/// Positions of the masters (rad or m); NaN where there is none.
fn measured(sample: Option<&Sample>) -> [f64; AXES] {
    sample.map_or([f64::NAN; AXES], |sample| {
        where_present(sample.master_present, &sample.master_position)
    })
}

/// Positions of the handles by their own encoders (rad or m); NaN where there is none.
fn handles(sample: Option<&Sample>) -> [f64; AXES] {
    sample.map_or([f64::NAN; AXES], |sample| {
        where_present(sample.slave_present, &sample.slave_position)
    })
}

/// The positions whose bit is set; NaN where it is not.
fn where_present(present: u8, positions: &[f64; AXES]) -> [f64; AXES] {
    std::array::from_fn(|axis| if present >> axis & 1 == 1 { positions[axis] } else { f64::NAN })
}

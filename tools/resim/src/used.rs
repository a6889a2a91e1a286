//! The messages that a step used, in words.

use ipc_types::{EnableToken, GateState, Mode, MotorCommand, Sample, Setpoint, WatchdogState};

use crate::report::Used;

/// Age of a time at another one (ms).
fn age_ms(now_ns: u64, then_ns: u64) -> f64 {
    (now_ns as f64 - then_ns as f64) * 1e-6
}

/// The values of the rig's axes.
fn values(values: &[f64], axes: u8) -> String {
    let shown: Vec<_> =
        values.iter().take(usize::from(axes).max(1)).map(|value| format!("{value:?}")).collect();
    format!("[{}]", shown.join(", "))
}

/// A sample at a time [ns, CLOCK_MONOTONIC].
pub(crate) fn used_sample(sample: &Sample, now_ns: u64) -> Used {
    let Sample { tick, axes, .. } = *sample;
    let gate = GateState::from_code(sample.gate_state).map_or("unknown", GateState::text);
    Used {
        topic: "sample",
        incarnation: sample.incarnation,
        sequence: sample.sequence,
        text: format!(
            "tick {tick}, {:.3} ms old, master {}, slave {}, torque {}, written {} V, motor {} V, \
             gate {gate}, epoch {}, echoes token {}",
            age_ms(now_ns, sample.scan_time_ns),
            values(&sample.master_position, axes),
            values(&sample.slave_position, axes),
            values(&sample.slave_torque, axes),
            values(&sample.output_v, axes),
            values(&sample.motor_v, axes),
            sample.epoch,
            sample.token_sequence,
        ),
    }
}

/// A setpoint at a time [ns, CLOCK_MONOTONIC].
pub(crate) fn used_setpoint(setpoint: &Setpoint, now_ns: u64) -> Used {
    let mode = Mode::from_code(setpoint.mode).map_or("unknown", Mode::text);
    let lease_ms = -age_ms(now_ns, setpoint.lease_until_ns);
    Used {
        topic: "setpoint",
        incarnation: setpoint.incarnation,
        sequence: setpoint.sequence,
        text: format!(
            "mode {mode}, position {}, velocity {}, lease {lease_ms:.3} ms, segment {}",
            values(&setpoint.position, setpoint.axes),
            values(&setpoint.velocity, setpoint.axes),
            setpoint.segment,
        ),
    }
}

/// A command at a time [ns, CLOCK_MONOTONIC].
pub(crate) fn used_command(command: &MotorCommand, now_ns: u64) -> Used {
    let mode = Mode::from_code(command.mode).map_or("unknown", Mode::text);
    Used {
        topic: "command",
        incarnation: command.incarnation,
        sequence: command.sequence,
        text: format!(
            "{:.3} ms old, volts {} V, mode {mode}, reference {}, computed from tick {}, epoch {}, \
             echoes token {}",
            age_ms(now_ns, command.computed_ns),
            values(&command.volts, command.axes),
            values(&command.reference_position, command.axes),
            command.sample_tick,
            command.epoch,
            command.token_sequence,
        ),
    }
}

/// A token at a time [ns, CLOCK_MONOTONIC].
pub(crate) fn used_token(token: &EnableToken, now_ns: u64) -> Used {
    let state = WatchdogState::from_code(token.state).map_or("unknown", WatchdogState::text);
    Used {
        topic: "token",
        incarnation: token.incarnation,
        sequence: token.sequence,
        text: format!(
            "{state}, epoch {}, {:.3} ms old",
            token.epoch,
            age_ms(now_ns, token.issued_ns)
        ),
    }
}

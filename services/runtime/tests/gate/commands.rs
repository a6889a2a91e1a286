//! Commands: stale, backwards, from an old sample, beyond what is allowed.

use super::*;

#[test]
fn sr_05_stale_command_latches() {
    let mut rig = Rig::opened();
    let command = rig.command;
    for _ in 0..11 {
        rig.step();
        rig.renew();
        rig.command = command;
    }
    rig.latches_closed(GateCause::CommandStale);
}

#[test]
fn sr_05_command_sequence_or_sample_backwards_latches() {
    for field in 0..4 {
        let mut rig = Rig::opened();
        rig.renew();
        rig.step();
        let last = rig.command;
        rig.renew();
        match field {
            0 => rig.command.sequence = last.sequence,
            1 => rig.command.sample_tick = last.sample_tick - 1,
            2 => rig.command.sample_time_ns = last.sample_time_ns - 1,
            _ => rig.command.computed_ns = last.computed_ns - 1,
        }
        rig.latches_closed(GateCause::CommandBackwards);
    }
}

#[test]
fn sr_05_a_second_command_that_answers_the_same_sample_is_in_order() {
    let mut rig = Rig::opened();
    let first = rig.command;
    rig.renew();
    (rig.command.sample_tick, rig.command.sample_time_ns) =
        (first.sample_tick, first.sample_time_ns);
    let output = rig.step();
    assert_eq!((output.state, output.command_sequence), (GateState::Open, first.sequence + 1));
}

#[test]
fn sr_05_command_from_an_old_sample_latches() {
    let mut rig = Rig::opened();
    let sample_time = rig.command.sample_time_ns;
    while rig.now < sample_time + 10 * MS {
        rig.renew();
        rig.command.sample_time_ns = sample_time;
        assert_eq!(rig.step().state, GateState::Open);
    }
    rig.renew();
    rig.command.sample_time_ns = sample_time;
    rig.latches_closed(GateCause::CommandSampleOld);
}

#[test]
fn sr_05_command_from_the_future_latches() {
    for field in 0..3 {
        let mut rig = Rig::opened();
        rig.renew();
        let future = rig.now + config().future_ns + 1;
        match field {
            0 => rig.command.computed_ns = future,
            1 => rig.command.time_ns = future,
            _ => rig.command.sample_time_ns = future,
        }
        // What follows must not look like a step backwards from that future.
        let output = rig.step();
        assert_eq!(
            (output.state, output.cause),
            (GateState::LatchedClosed, GateCause::CommandTime)
        );
    }
}

#[test]
fn sr_06_not_finite_latches_on_any_axis() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        for axis in 0..AXES {
            let mut rig = Rig::opened();
            rig.renew();
            rig.command.volts[axis] = bad;
            rig.latches_closed(GateCause::CommandNotFinite);
        }
    }
}

#[test]
fn sr_06_beyond_the_limit_burns_and_unused_axes_get_nothing() {
    for (axis, volts) in [(0, 5.001), (0, -5.001), (1, 3.001), (2, 0.001)] {
        let mut rig = Rig::opened();
        rig.renew();
        rig.command.volts[axis] = volts;
        rig.latches_closed(GateCause::CommandRange);
    }
    let mut rig = Rig::opened();
    rig.renew();
    rig.command.volts = [5.0, -3.0, 0.0];
    assert_eq!(rig.step().volts, [5.0, -3.0, 0.0]);
}

#[test]
fn sr_06_a_limit_that_is_no_number_lets_nothing_pass() {
    for limit in [f64::NAN, f64::INFINITY, -1.0, 0.0] {
        let mut rig = Rig::new();
        rig.gate = Gate::new(GateConfig { volts_max: [limit; AXES], ..config() });
        rig.renew();
        assert_eq!(rig.step().volts, [0.0; AXES]);
        assert_eq!(rig.gate.state(), GateState::LatchedClosed);
    }
}

//! SR-26, whole-system: a protocol ends with every trip, with its client, and with `farreach stop`;
//! once it has ended, power alone moves nothing.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::process::{Child, Stdio};
use std::time::Duration;

use ipc_types::{EXPERIMENT_COMMANDS, ExperimentAnswer, ExperimentRequest};
use serde_json::Value;

use common::{Signal, TestRig, kill, told, wait_for};

const LIMIT: Duration = Duration::from_secs(60);
/// The guided movement sweeps more than 1 rad within half a second; from here on it counts as one
/// (rad).
const MOVES: f64 = 0.2;
/// Largest movement of a handle at rest: two counts of its encoder are noise (rad).
const AT_REST: f64 = 0.01;

/// Samples of half a second, and of a whole period of the guided movement (2 kHz, 1 Hz).
const SHORTLY: &str = "1000";
const PERIOD: &str = "2000";

/// What the rig did within some samples.
struct Observed {
    /// Difference of the handle motor's extreme positions (rad).
    moved_rad: f64,
    /// Largest voltage at the motor, without its sign (V).
    volts: f64,
}

struct Bench {
    rig: TestRig,
    domain: runtime::Domain,
}

impl Bench {
    fn status(&self) -> Option<ExperimentAnswer> {
        let node = self.domain.node("asker").unwrap();
        let limit = Duration::from_secs(5);
        runtime::call(&node, &EXPERIMENT_COMMANDS, &ExperimentRequest::Status, limit).ok()
    }

    fn running(&self) -> bool {
        self.status().is_some_and(|status| status.running)
    }

    /// Starts a client whose protocol moves the handle. Where the rig has no power, or a loaded
    /// host trips it, rightly, it is powered and the start repeated.
    fn client(&self) -> Child {
        for attempt in 0..20 {
            if attempt > 0 {
                self.power_cycle();
            }
            let mut command = self.rig.farreach(["run", "guided-1hz"]);
            command.stdout(Stdio::piped()).stderr(Stdio::piped());
            let mut child = command.spawn().unwrap();
            let moves = wait_for(LIMIT, || {
                child.try_wait().unwrap().is_some() || self.observe(SHORTLY).moved_rad > MOVES
            });
            assert!(moves, "the handle does not move: {:?}", self.status());
            if child.try_wait().unwrap().is_none() && self.running() {
                return child;
            }
            child.kill().unwrap();
            child.wait().unwrap();
        }
        panic!("the rig trips each time: {:?}", self.status());
    }

    /// Removes the power, if it is on, and restores it once the handle is at rest: a new enable
    /// epoch. After a trip in mid-movement the line releases its stored energy: without power the
    /// motor moves on by up to 0.09 rad within 0.2 s.
    fn power_cycle(&self) {
        let _off = self.rig.run(["disarm"]);
        assert!(wait_for(LIMIT, || self.observe(SHORTLY).moved_rad < AT_REST), "the handle drifts");
        self.rig.power_up();
    }

    fn observe(&self, samples: &str) -> Observed {
        let echo = self.rig.ok(["probe", "echo", "sample", "--count", samples, "--json"]);
        let (mut least, mut most, mut volts) = (f64::INFINITY, f64::NEG_INFINITY, 0.0_f64);
        for line in echo.lines() {
            let line: Value = serde_json::from_str(line).unwrap();
            let first = |field: &str| line["fields"][field][0].as_f64().unwrap();
            let position = first("master_position");
            (least, most) = (least.min(position), most.max(position));
            volts = volts.max(first("motor_v").abs());
        }
        Observed { moved_rad: most - least, volts }
    }

    /// Powers a rig whose protocol has ended; asserts that neither voltage nor movement follows.
    fn assert_power_moves_nothing(&self, after: &str) {
        self.power_cycle();
        let Observed { moved_rad, volts } = self.observe(PERIOD);
        assert!(volts == 0.0, "{after}: {volts} V at the motor without `run`");
        assert!(moved_rad < AT_REST, "{after}: the handle moved by {moved_rad} rad");
        assert!(!self.running(), "{after}: {:?}", self.status());
    }
}

fn pid(child: &Child) -> i32 {
    i32::try_from(child.id()).unwrap()
}

#[test]
fn sr_26_a_protocol_ends_with_a_trip_with_its_client_and_with_stop() {
    let rig = TestRig::patient("protocol-end");
    rig.up_homed();
    let domain = runtime::Domain::open(rig.name()).unwrap();
    let bench = Bench { rig, domain };

    // The client is stopped (Ctrl-Z), then emergency stop, then power again.
    let mut stopped = bench.client();
    kill(pid(&stopped), Signal::STOP);
    bench.rig.ok(["estop"]);
    bench.assert_power_moves_nothing("after an emergency stop");
    kill(pid(&stopped), Signal::CONT);
    assert!(!stopped.wait().unwrap().success());
    bench.assert_power_moves_nothing("after the client was continued");

    // The client is killed: its lease expires, the handle comes to rest.
    let mut killed = bench.client();
    killed.kill().unwrap();
    killed.wait().unwrap();
    assert!(wait_for(LIMIT, || !bench.running()), "{:?}", bench.status());
    bench.assert_power_moves_nothing("after the client was killed");

    // The experiment process is killed while the client is stopped, with a trip in between.
    let mut stopped = bench.client();
    kill(pid(&stopped), Signal::STOP);
    let status = bench.rig.launcher_status();
    let victim = status.unit("experiment").unwrap().process.unwrap();
    kill(victim.pid, Signal::KILL);
    bench.rig.ok(["estop"]);
    let back = wait_for(LIMIT, || bench.status().is_some_and(|status| !status.running));
    assert!(back, "{:?}", bench.status());
    bench.assert_power_moves_nothing("after the experiment process was restarted");
    stopped.kill().unwrap();
    stopped.wait().unwrap();

    // `run` on a busy rig names the protocol and the way to end it; `stop` ends it.
    let ended = (0..20).any(|_| {
        let client = bench.client();
        let busy = bench.rig.run(["run", "guided-1hz"]);
        let stop = bench.rig.ok(["stop"]);
        let output = client.wait_with_output().unwrap();
        assert!(!output.status.success(), "{}", told(&output));
        if !stop.contains("guided-1hz stopped after") {
            return false; // the rig tripped by itself first
        }
        let busy = told(&busy);
        assert!(busy.contains("guided-1hz is running") && busy.contains("farreach stop"), "{busy}");
        true
    });
    assert!(ended, "the rig trips each time");
    assert_eq!(bench.rig.ok(["stop"]).trim(), "no protocol is running");
    bench.assert_power_moves_nothing("after `farreach stop`");

    let Bench { rig, domain } = bench;
    drop(domain);
    rig.down();
}

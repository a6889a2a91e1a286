//! SR-26: what ends a protocol, with time, watchdog and client driven by hand.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::sync::Arc;

use experiment::player::{CLIENT_LEASE_NS, Change, Permission, Player, Program, Reason};
use experiment::state::PlayerState;
use ipc_types::{AXES, Mode, Setpoint};
use rig::RigFile;
use rig::protocol::Protocol;

const MS: u64 = 1_000_000;
const PERIOD: u64 = 2 * MS;
const EPOCH: u64 = 7;
const ENABLED: Permission = Permission::Enabled(EPOCH);
const TEXT: &str = "[protocol]\nname = \"sine\"\n[[segments]]\nkind = \"guided_sine\"\n\
                    amplitude_deg = 30\nfrequency_hz = 1\nduration_s = 60\nfade_in_s = 1\n";

/// The state with which another process would resume.
fn state(player: &Player, session: u64, client: u64) -> PlayerState {
    let (segment, running) = (player.status().segment, !player.is_ending());
    let begun = player.program().unwrap().state(session, player.epoch(), client);
    PlayerState { segment, running, scan: player.scan_state(), ..begun }
}

fn program(text: &str) -> Arc<Program> {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../launch/rigs/hydrostatic.toml");
    let rig = RigFile::load(path).unwrap();
    Arc::new(Program::new(&Protocol::parse(text, "sine.toml").unwrap(), &rig).unwrap())
}

/// A player with its clock; the handle follows perfectly.
struct Bench {
    player: Player,
    now_ns: u64,
    measured: [f64; AXES],
}

impl Bench {
    fn started() -> Self {
        let mut player = Player::default();
        player.start(program(TEXT), EPOCH);
        Self { player, now_ns: 1_000 * MS, measured: [0.0; AXES] }
    }

    fn resumed(state: &PlayerState) -> Self {
        let mut player = Player::default();
        player.resume(state, program(&state.text)).unwrap();
        Self { player, now_ns: 90_000 * MS, measured: [0.2, 0.0, 0.0] }
    }

    /// One cycle; the client has last renewed its lease at `renewed_ns`.
    fn cycle(
        &mut self,
        permission: Permission,
        renewed_ns: u64,
    ) -> (Option<Setpoint>, Option<Change>) {
        self.now_ns += PERIOD;
        self.player.supervise(self.now_ns, permission, renewed_ns);
        let output = self.player.step(self.now_ns, &self.measured);
        if let Some(setpoint) = output.setpoint {
            self.measured = setpoint.position;
        }
        (output.setpoint, output.change)
    }

    /// Cycles with a client that is alive; the changes.
    fn run(&mut self, permission: Permission, ms: u64) -> Vec<Change> {
        let cycles = ms * MS / PERIOD;
        (0..cycles).filter_map(|_| self.cycle(permission, self.now_ns).1).collect()
    }
}

fn mode(setpoint: Option<Setpoint>) -> Mode {
    Mode::from_code(setpoint.unwrap().mode).unwrap()
}

#[test]
fn sr_26_a_trip_ends_the_protocol_and_a_later_enable_moves_nothing() {
    for lost in [Permission::Withdrawn, Permission::Enabled(EPOCH + 1), Permission::Unknown] {
        let mut bench = Bench::started();
        assert_eq!(bench.run(ENABLED, 3_300), [Change::Started]);
        assert!(bench.measured[0].abs() > 0.05, "in movement");
        let (setpoint, change) = bench.cycle(lost, bench.now_ns);
        assert_eq!(change, Some(Change::Aborted(0, Reason::PermissionLost)), "{lost:?}");
        // With the cycle that ends it, since a client may ask at once whether it was only stopped.
        let status = bench.player.status();
        assert!(!status.running && status.permission_lost, "{lost:?}: {status:?}");
        assert_eq!(mode(setpoint), Mode::Passive);
        let rest = bench.measured;
        for permission in [Permission::Withdrawn, Permission::Enabled(EPOCH + 1), ENABLED] {
            assert_eq!(bench.run(permission, 1_000), []);
            assert_eq!(bench.measured, rest);
        }
        assert!(!bench.player.is_running() && !bench.player.status().completed);
    }
}

#[test]
fn sr_26_a_protocol_that_is_started_without_permission_ends_at_once() {
    let mut bench = Bench::started();
    let (setpoint, change) = bench.cycle(Permission::Withdrawn, bench.now_ns);
    assert_eq!(change, Some(Change::Aborted(0, Reason::PermissionLost)));
    assert_eq!(mode(setpoint), Mode::Passive);
}

#[test]
fn sr_26_a_trip_during_a_stop_or_a_hold_goes_to_passive_at_once() {
    for stopped_ms in [100, 700] {
        let mut bench = Bench::started();
        bench.run(ENABLED, 3_300);
        bench.player.stop();
        assert_eq!(bench.run(ENABLED, stopped_ms), [Change::Stopped(0)]);
        let (setpoint, change) = bench.cycle(Permission::Withdrawn, bench.now_ns);
        assert_eq!((mode(setpoint), change), (Mode::Passive, None));
    }
}

#[test]
fn sr_26_a_client_that_is_gone_ends_the_protocol_in_good_order() {
    let mut bench = Bench::started();
    bench.run(ENABLED, 3_300);
    let last_word_ns = bench.now_ns;
    let lease_ns = CLIENT_LEASE_NS;
    let mut setpoints = Vec::new();
    let mut changes = Vec::new();
    while bench.now_ns < last_word_ns + lease_ns + 1_500 * MS {
        let (setpoint, change) = bench.cycle(ENABLED, last_word_ns);
        changes.extend(change.map(|change| (bench.now_ns - last_word_ns, change)));
        setpoints.extend(setpoint);
    }
    assert_eq!(changes, [(lease_ns + PERIOD, Change::Aborted(0, Reason::ClientGone))]);
    for pair in setpoints.windows(2) {
        assert!((pair[1].position[0] - pair[0].position[0]).abs() < 0.012, "{:?}", pair[1]);
    }
    let modes = |from: usize| mode(setpoints.get(from).copied());
    let ended = (lease_ns / PERIOD) as usize;
    assert_eq!(modes(ended + 100), Mode::Position, "it fades to rest");
    assert_eq!(modes(ended + 300), Mode::Hold);
    assert_eq!(modes(ended + 600), Mode::Passive);
    // A client that wakes up again does not bring it back.
    assert_eq!(bench.run(ENABLED, 1_000), []);
}

#[test]
fn a_client_that_renews_within_the_lease_keeps_its_protocol() {
    let mut bench = Bench::started();
    let mut renewed_ns = bench.now_ns;
    for _ in 0..10_000 {
        if bench.now_ns - renewed_ns >= CLIENT_LEASE_NS {
            renewed_ns = bench.now_ns;
        }
        let (_, change) = bench.cycle(ENABLED, renewed_ns);
        assert!(matches!(change, None | Some(Change::Started)), "{change:?}");
    }
}

fn kept() -> PlayerState {
    let mut bench = Bench::started();
    bench.run(ENABLED, 2_000);
    state(&bench.player, 1, 5)
}

#[test]
fn sr_26_after_a_restart_it_goes_on_only_while_enabled_and_with_its_client() {
    let mut bench = Bench::resumed(&kept());
    // Neither the watchdog nor the client has been heard.
    for permission in [Permission::Unknown, ENABLED] {
        for _ in 0..100 {
            assert_eq!(bench.cycle(permission, 0), (None, None));
        }
    }
    let (setpoint, change) = bench.cycle(ENABLED, bench.now_ns + PERIOD);
    assert_eq!(change, Some(Change::Resumed(0)));
    assert_eq!(setpoint.unwrap().position[0], 0.2);
}

#[test]
fn sr_26_after_a_restart_a_trip_meanwhile_ends_it() {
    for lost in [Permission::Withdrawn, Permission::Enabled(EPOCH + 1)] {
        let mut bench = Bench::resumed(&kept());
        let (setpoint, change) = bench.cycle(lost, bench.now_ns);
        assert_eq!(change, Some(Change::Aborted(0, Reason::PermissionLost)));
        assert_eq!(mode(setpoint), Mode::Passive);
        assert!(!state(&bench.player, 1, 5).running);
    }
}

#[test]
fn sr_26_after_a_restart_silence_of_client_or_watchdog_ends_it() {
    for (permission, reason) in
        [(ENABLED, Reason::ClientGone), (Permission::Unknown, Reason::PermissionLost)]
    {
        let mut bench = Bench::resumed(&kept());
        let cycles = CLIENT_LEASE_NS / PERIOD;
        for _ in 0..=cycles {
            assert_eq!(bench.cycle(permission, 0), (None, None));
        }
        let (setpoint, change) = bench.cycle(permission, 0);
        assert_eq!(change, Some(Change::Aborted(0, reason)));
        assert_eq!(bench.player.status().permission_lost, reason == Reason::PermissionLost);
        assert_eq!(mode(setpoint), Mode::Passive);
    }
}

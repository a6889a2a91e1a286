//! Which rates can be armed: what a rig file's check says of rates and phases, against the cores of
//! all processes on the time grid.
#![allow(clippy::unwrap_used)]

mod cores;

use cores::{Rig, Timeline};
use ipc_types::{GateState, Profile, WatchdogState};
use lock_step::simplified;
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::{Rng, SeedableRng};
use rig::{ControlOptions, Phases, Rates, RigFile};

const SECOND_NS: u64 = 1_000_000_000;
/// What a rig file may say ([`Rates`]), as far as the rates divide a second.
const ACQUISITION_HZ: std::ops::RangeInclusive<u32> = 100..=10_000;
const CONTROL_HZ: std::ops::RangeInclusive<u32> = 50..=2_000;
const WATCHDOG_HZ: std::ops::RangeInclusive<u32> = 100..=5_000;

const REST: &str = r#"[protocol]
name = "rest"

[[segments]]
kind = "rest"
duration_s = 1.0
"#;

/// A rig whose law is stable at every rate: a file with gains that are not is refused for them.
fn rig() -> RigFile {
    let text = include_str!("../../../launch/rigs/hydrostatic.toml");
    let mut rig = simplified(RigFile::parse(text, "rig.toml").unwrap());
    for axis in &mut rig.axes {
        axis.control.position_gain *= 0.01;
        axis.control.velocity_gain *= 0.01;
        axis.control.options = ControlOptions::default();
    }
    rig
}

fn fits(a: u32, b: u32) -> bool {
    a.is_multiple_of(b) || b.is_multiple_of(a)
}

/// All rates of acquisition, control and watchdog that a rig file may have.
fn all_rates() -> Vec<Rates> {
    let of = |range: std::ops::RangeInclusive<u32>| {
        range.filter(|rate| SECOND_NS.is_multiple_of(u64::from(*rate))).collect::<Vec<u32>>()
    };
    let mut all = Vec::new();
    for acquisition_hz in of(ACQUISITION_HZ) {
        for control_hz in of(CONTROL_HZ) {
            for watchdog_hz in of(WATCHDOG_HZ) {
                let divide = acquisition_hz.is_multiple_of(control_hz)
                    && watchdog_hz.is_multiple_of(control_hz)
                    && fits(acquisition_hz, watchdog_hz);
                if divide {
                    let experiment_hz = control_hz;
                    all.push(Rates { acquisition_hz, control_hz, watchdog_hz, experiment_hz });
                }
            }
        }
    }
    all
}

/// Phases that no two loops share, with every loop anywhere in its period that a rig file allows.
fn phases(rates: &Rates, generator: &mut Xoshiro256PlusPlus) -> Phases {
    let shortest = rates.acquisition_period_ns().min(rates.watchdog_period_ns());
    // Five places within the shortest period, in any order, and any of a loop's shortest periods.
    let slot = shortest / 5;
    let mut places = [0, 1, 2, 3, 4];
    for at in (1..5).rev() {
        places.swap(at, (generator.next_u64() % (at as u64 + 1)) as usize);
    }
    let mut within = |place: u64, period: u64, least: u64| {
        let phases = (0..period / shortest).map(|turn| turn * shortest + place * slot);
        let phases: Vec<u64> = phases.filter(|phase| *phase >= least).collect();
        phases.get((generator.next_u64() % phases.len().max(1) as u64) as usize).copied()
    };
    let acquisition_period = rates.acquisition_period_ns();
    let (first, second) = (places[0].min(places[1]), places[0].max(places[1]));
    let simulator_ns = within(first, acquisition_period.min(shortest), 0).unwrap();
    let acquisition_ns = within(second, acquisition_period, simulator_ns).unwrap();
    let control_period = rates.control_period_ns();
    // Later than acquisition; where its place is not, acquisition is at its earliest.
    let (acquisition_ns, control_ns) = match within(places[2], control_period, acquisition_ns + 1) {
        Some(control_ns) => (acquisition_ns, control_ns),
        None => (simulator_ns.max(slot), control_period - slot.min(control_period / 2)),
    };
    Phases {
        simulator_ns,
        acquisition_ns,
        control_ns,
        watchdog_ns: within(places[3], rates.watchdog_period_ns(), 0).unwrap(),
        experiment_ns: within(places[4], rates.experiment_period_ns(), 0).unwrap(),
    }
}

/// Whether the phases are such as a rig file may have: in the order of the data flow, and no two
/// loops at once.
fn valid(rates: &Rates, phases: &Phases) -> bool {
    let shortest = rates.acquisition_period_ns().min(rates.watchdog_period_ns());
    let all = [
        phases.simulator_ns,
        phases.acquisition_ns,
        phases.control_ns,
        phases.watchdog_ns,
        phases.experiment_ns,
    ];
    let apart = |a: u64, b: u64| {
        let apart = (a % shortest).abs_diff(b % shortest);
        apart.min(shortest - apart) >= 20_000
    };
    let distinct = (0..5).all(|a| (a + 1..5).all(|b| apart(all[a], all[b])));
    distinct
        && phases.simulator_ns < phases.acquisition_ns
        && phases.acquisition_ns < phases.control_ns
        && phases.acquisition_ns < rates.acquisition_period_ns()
        && phases.control_ns < rates.control_period_ns()
}

/// Whether the cores are armed and enabled in that profile, and stay so for a quarter of a second.
fn arms(rig: &RigFile, profile: Profile) -> Result<(), String> {
    let (mut live, mut timeline) = (Rig::of_profile(rig, REST, profile), Timeline::new(rig));
    live.may_trip = true;
    let periods = rig.rates.acquisition_hz * 6 / 10;
    for tick in timeline.first..timeline.first + u64::from(periods) {
        timeline.run(&mut live, tick);
    }
    let (state, gate) = (live.machine.state(), live.gate.state());
    match state == WatchdogState::Enabled && gate == GateState::Open {
        true => Ok(()),
        false => Err(format!("{state}, {:?}, gate {gate}", live.machine.cause())),
    }
}

/// Of the 949 combinations of rates some (all with `FARREACH_ALL_RATES=1`), each with the phases of
/// the shipped rigs where they fit and with drawn ones: what the check accepts for a profile arms
/// in it, and what misses a timeout even without the tolerated lateness does not.
#[test]
fn what_is_accepted_for_a_profile_arms_in_it_and_what_is_not_does_not() {
    let mut rig = rig();
    let shipped = rig.phases;
    let all = std::env::var_os("FARREACH_ALL_RATES").is_some();
    let mut generator = Xoshiro256PlusPlus::seed_from_u64(1);
    let (mut armed, mut refused) = ([0, 0], [0, 0]);
    for (number, rates) in all_rates().into_iter().enumerate() {
        rig.rates = rates;
        for drawn in [false, true] {
            rig.phases = if drawn { phases(&rates, &mut generator) } else { shipped };
            // Of the slow ones, of which most cannot be armed, more.
            let slow = rates.control_hz <= 250 && rates.acquisition_hz <= 1000;
            let tried = all || number % if slow { 3 } else { 13 } == 0;
            if !tried || !valid(&rates, &rig.phases) {
                continue;
            }
            for (at, &profile) in Profile::ALL.iter().enumerate() {
                let about = format!("{profile}: {rates:?}, {:?}", rig.phases);
                match rig.missed_timeout(profile) {
                    None => {
                        let result = arms(&rig, profile);
                        assert!(result.is_ok(), "{about}: {result:?}");
                        armed[at] += 1;
                    }
                    Some(missed) => {
                        let beyond = missed.oldest_ns > missed.limit_ns + 120_000;
                        if beyond && !missed.what.contains("enable line") {
                            assert!(arms(&rig, profile).is_err(), "{about}: {missed}");
                            refused[at] += 1;
                        }
                    }
                }
            }
        }
    }
    println!("armed {armed:?}, refused and not armed {refused:?} ({:?})", Profile::ALL);
    assert!(armed.iter().all(|count| *count > 20) && refused[0] > 5, "{armed:?} {refused:?}");
}

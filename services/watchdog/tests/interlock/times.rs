//! Times and ages at their limits: what just reaches one trips nothing, what is beyond it does.

use ipc_types::{GateState, Profile, TripCause, Verb, WatchdogState};
use watchdog::interlock::{FaultSet, Refusal};

use crate::world::{MS, World, config};

const PROFILES: [Profile; 2] = [Profile::Realtime, Profile::BestEffort];

#[test]
fn sr_19_silence_up_to_the_timeout_is_no_loss() {
    for (profile, timeout_ms) in [(Profile::Realtime, 8), (Profile::BestEffort, 60)] {
        for (cause, acquisition) in
            [(TripCause::AcquisitionLost, true), (TripCause::ControlLost, false)]
        {
            let mut world = World::in_state(profile, WatchdogState::Armed);
            (world.acquisition_runs, world.control_runs) = (!acquisition, acquisition);
            world.cycles(timeout_ms);
            assert_eq!(world.interlock.state(), WatchdogState::Armed, "{profile} {cause}");
            world.cycle();
            assert_eq!(
                (world.interlock.state(), world.interlock.cause()),
                (WatchdogState::Tripped, cause),
                "{profile}"
            );
        }
    }
}

#[test]
fn sr_19_a_watchdog_is_late_after_more_than_a_token_s_life() {
    for profile in PROFILES {
        let life_ns = config(profile).token_life_ns;
        for (gap_ns, late) in [(life_ns, false), (life_ns + 1, true)] {
            let mut world = World::in_state(profile, WatchdogState::Armed);
            world.now += gap_ns;
            world.sample_now();
            world.command_now();
            world.step();
            let faults = world.interlock.active_faults();
            assert_eq!(faults.contains(TripCause::WatchdogLate), late, "{profile}: {gap_ns} ns");
        }
    }
}

#[test]
fn sr_11_a_message_from_just_ahead_of_the_clock_passes_and_one_from_the_future_trips() {
    for beyond in [0, 1] {
        for field in 0..4 {
            let mut world = World::in_state(Profile::Realtime, WatchdogState::Enabled);
            let mut interlock = world.interlock.clone();
            world.now += MS;
            world.sample_now();
            world.command_now();
            let ahead = world.now + config(Profile::Realtime).future_ns + beyond;
            match field {
                0 => world.sample.time_ns = ahead,
                1 => world.sample.scan_time_ns = ahead,
                2 => world.command.time_ns = ahead,
                _ => world.command.computed_ns = ahead,
            }
            interlock.observe_sample(&world.sample);
            interlock.observe_command(&world.command);
            interlock.step(world.now, world.peers);
            let cause =
                if field < 2 { TripCause::SampleBackwards } else { TripCause::CommandBackwards };
            let expected = match beyond {
                0 => (WatchdogState::Enabled, TripCause::Started),
                _ => (WatchdogState::Tripped, cause),
            };
            assert_eq!((interlock.state(), interlock.cause()), expected, "field {field}");
        }
    }
}

#[test]
fn sr_11_a_momentary_fault_is_held_for_its_time_and_no_longer() {
    for (profile, held_ms) in [(Profile::Realtime, 16), (Profile::BestEffort, 120)] {
        let mut world = World::in_state(profile, WatchdogState::Disarmed);
        world.sample.master_counts[0] += 21;
        world.cycles(held_ms);
        let refused = Err(Refusal::FaultActive(TripCause::EncoderJump));
        assert_eq!(world.verb(Verb::Reset), refused, "{profile}");
        world.cycle();
        assert_eq!(world.verb(Verb::Reset), Ok(WatchdogState::Disarmed), "{profile}");
    }
}

#[test]
fn sr_11_a_command_may_answer_a_sample_as_old_as_the_token_s_way_may_be_long() {
    for (profile, oldest_ms) in [(Profile::Realtime, 13), (Profile::BestEffort, 100)] {
        for (beyond, stale) in [(0, false), (1, true)] {
            let mut world = World::in_state(profile, WatchdogState::Enabled);
            let mut interlock = world.interlock.clone();
            world.now += MS;
            world.sample_now();
            world.command_now();
            world.command.sample_time_ns = world.now - oldest_ms * MS - beyond;
            interlock.observe_sample(&world.sample);
            interlock.observe_command(&world.command);
            interlock.step(world.now, world.peers);
            let found = interlock.active_faults().contains(TripCause::CommandStale);
            assert_eq!(found, stale, "{profile}");
        }
    }
}

#[test]
fn sr_13_an_echo_older_than_the_kept_issue_times_is_lost() {
    let mut world = World::in_state(Profile::Realtime, WatchdogState::Armed);
    world.cycles(300);
    let newest = world.token.sequence;
    // A token 256 places back would be looked up in the place of the newest.
    for behind in 255..300 {
        let mut world = world.clone();
        world.token.sequence = newest - behind;
        world.now += MS;
        world.sample_now();
        world.token.sequence = newest;
        world.command_now();
        world.step();
        assert!(world.interlock.active_faults().contains(TripCause::EchoLost), "{behind}");
    }
}

#[test]
fn sr_16_the_gate_has_its_time_to_close_before_it_hinders_arming() {
    for (profile, time_ms) in [(Profile::Realtime, 13), (Profile::BestEffort, 100)] {
        for (beyond_ms, expected) in [(0, Ok(WatchdogState::Armed)), (1, Err(Refusal::GateOpen))] {
            let mut world = World::in_state(profile, WatchdogState::Enabled);
            world.verb(Verb::Disarm).unwrap();
            world.gate_obeys = false;
            assert_eq!(world.sample.gate_state, GateState::Open.code());
            world.cycles(time_ms + beyond_ms);
            assert_eq!(world.verb(Verb::Arm), expected, "{profile}");
        }
    }
}

#[test]
fn sr_16_an_axis_that_creeps_by_two_counts_is_at_rest() {
    let mut world = World::in_state(Profile::Realtime, WatchdogState::Disarmed);
    for cycle in 0..40u32 {
        // 2 counts in the window of 8 ms.
        world.sample.master_position[0] = f64::from(cycle / 4) * crate::world::COUNT;
        world.cycle();
    }
    assert_eq!(world.verb(Verb::Arm), Ok(WatchdogState::Armed));
}

/// Between two toggles lies the profile's gap at most, also where the watchdog itself is slow.
#[test]
fn sr_24_the_line_toggles_for_samples_up_to_its_age_and_trips_beyond_its_gap() {
    for (profile, pause_ms) in [(Profile::Realtime, 3), (Profile::BestEffort, 15)] {
        let mut world = World::in_state(profile, WatchdogState::Enabled);
        world.acquisition_runs = false;
        for _ in 0..pause_ms {
            assert!(world.cycle().toggle_line, "{profile}");
        }
        assert!(!world.cycle().toggle_line, "{profile}");

        let gap_ns = config(profile).enable_line_gap_ns;
        let mut world = World::in_state(profile, WatchdogState::Enabled);
        let toggled_ns = world.now;
        for (after_ns, expected) in [
            (pause_ms * MS + 1, WatchdogState::Enabled),
            (gap_ns, WatchdogState::Enabled),
            (gap_ns + 1, WatchdogState::Tripped),
        ] {
            world.now = toggled_ns + after_ns;
            world.command_now();
            assert!(!world.step().toggle_line, "{profile}");
            assert_eq!(world.interlock.state(), expected, "{profile}: {after_ns} ns");
        }
        assert_eq!(world.interlock.cause(), TripCause::AcquisitionLost);
    }
}

#[test]
fn sr_33_what_a_hand_does_after_the_power_ended_is_no_fault() {
    let mut world = World::in_state(Profile::Realtime, WatchdogState::Enabled);
    world.verb(Verb::Disarm).unwrap();
    for cycle in 0..400 {
        world.sample.slave_position[0] = -2e-3 * f64::from(cycle);
        world.cycle();
        assert_eq!(world.interlock.active_faults(), FaultSet::NONE);
    }
    assert_eq!(world.interlock.state(), WatchdogState::Disarmed);
}

//! The fault table: each cause from each state, until a person brings the rig back.

use ipc_types::program_flow::{ACQUISITION_CYCLE, CONTROL_CYCLE, Checkpoint, signature};
use ipc_types::{MotorCommand, Profile, Sample, TripCause, Verb, WatchdogState};
use watchdog::interlock::Refusal;

use crate::world::{MS, World};

/// One row of the fault table: how it comes, how it goes, and what it does.
struct Fault {
    cause: TripCause,
    begin: fn(&mut World),
    end: fn(&mut World),
    /// Cycles (of 1 ms) until it must have acted, realtime and best-effort.
    within: [usize; 2],
}

/// For faults that end by themselves.
fn once(_: &mut World) {}

fn faults() -> impl Iterator<Item = Fault> {
    [peer_faults(), order_faults(), axis_faults(), sensor_faults(), flow_faults(), session_faults()]
        .into_iter()
        .flatten()
}

/// A peer is lost or was restarted.
fn peer_faults() -> Vec<Fault> {
    vec![
        Fault {
            cause: TripCause::AcquisitionLost,
            begin: |w| {
                w.acquisition_runs = false;
                w.control_runs = true;
            },
            end: |w| w.acquisition_runs = true,
            within: [9, 61],
        },
        Fault {
            cause: TripCause::ControlLost,
            begin: |w| w.control_runs = false,
            end: |w| w.control_runs = true,
            within: [9, 61],
        },
        Fault {
            cause: TripCause::AcquisitionChanged,
            begin: |w| {
                w.sample.incarnation = 22;
                w.sample.sequence = 0;
            },
            end: once,
            within: [1, 1],
        },
        Fault {
            cause: TripCause::ControlChanged,
            begin: |w| {
                w.command.incarnation = 42;
                w.command.sequence = 0;
            },
            end: once,
            within: [1, 1],
        },
        Fault {
            cause: TripCause::CommandStale,
            begin: |w| {
                w.control_runs = false;
                w.command_now();
                for _ in 0..120 {
                    w.now += MS / 2;
                    w.sample_now();
                    w.now += MS / 2;
                    w.sample_now();
                    w.command.sequence += 1;
                    (w.command.time_ns, w.command.computed_ns) = (w.now, w.now);
                    w.command.token_sequence = w.token.sequence;
                    w.command.flow = signature(CONTROL_CYCLE, w.token.sequence);
                    w.interlock.observe_command(&w.command);
                    w.step();
                }
            },
            end: |w| w.control_runs = true,
            within: [1, 1],
        },
    ]
}

/// Commands or samples are out of sequence.
fn order_faults() -> Vec<Fault> {
    vec![
        Fault {
            cause: TripCause::CommandBackwards,
            begin: |w| w.command.sequence -= 2,
            end: |w| w.command.sequence += 4,
            within: [1, 1],
        },
        Fault {
            cause: TripCause::CommandBackwards,
            begin: |w| {
                let tick = w.command.sample_tick;
                w.command.sequence += 1;
                w.command.sample_tick -= 1;
                w.interlock.observe_command(&w.command);
                w.command.sample_tick = tick;
            },
            end: once,
            within: [1, 1],
        },
        Fault {
            cause: TripCause::SampleBackwards,
            begin: |w| {
                let sequence = w.sample.sequence;
                w.sample.sequence -= 1;
                w.interlock.observe_sample(&w.sample);
                w.sample.sequence = sequence;
            },
            end: once,
            within: [1, 1],
        },
        Fault {
            cause: TripCause::SampleBackwards,
            begin: |w| {
                w.sample.sequence += 1;
                w.interlock.observe_sample(&w.sample);
            },
            end: once,
            within: [1, 1],
        },
        Fault {
            cause: TripCause::SampleBackwards,
            begin: |w| {
                w.sample.tick += 1;
                w.interlock.observe_sample(&w.sample);
            },
            end: once,
            within: [1, 1],
        },
        Fault {
            cause: TripCause::SampleBackwards,
            begin: |w| {
                w.sample.tick += 1;
                w.interlock.observe_sample(&Sample { sequence: w.sample.sequence - 1, ..w.sample });
            },
            end: once,
            within: [1, 1],
        },
        Fault {
            cause: TripCause::SampleBackwards,
            begin: |w| {
                w.sample.sequence += 1;
                w.interlock.observe_sample(&Sample { tick: w.sample.tick - 1, ..w.sample });
            },
            end: once,
            within: [1, 1],
        },
        Fault {
            cause: TripCause::CommandBackwards,
            begin: |w| w.interlock.observe_command(&w.command),
            end: once,
            within: [1, 1],
        },
    ]
}

/// A limit of an axis is exceeded.
fn axis_faults() -> Vec<Fault> {
    vec![
        Fault {
            cause: TripCause::PositionLimit,
            begin: |w| w.sample.master_position[0] = 1.001,
            end: |w| w.sample.master_position[0] = 0.0,
            within: [1, 1],
        },
        Fault {
            cause: TripCause::PositionLimit,
            begin: |w| w.sample.slave_position[0] = -1.001,
            end: |w| w.sample.slave_position[0] = 0.0,
            within: [1, 1],
        },
        Fault {
            cause: TripCause::SpeedLimit,
            begin: |w| {
                // 25 rad/s for 10 ms, each tick below what the encoder may jump; back to rest at
                // once.
                for tick in 0..20 {
                    w.now += MS / 2;
                    w.sample.master_position[0] = f64::from(tick) * 25.0 * 5e-4;
                    w.sample_now();
                    if tick % 2 == 1 {
                        w.command_now();
                        w.step();
                    }
                }
            },
            end: once,
            within: [2, 2],
        },
        Fault {
            cause: TripCause::VoltageLimit,
            begin: |w| w.command.volts[0] = -5.01,
            end: |w| w.command.volts[0] = 0.0,
            within: [1, 1],
        },
        Fault {
            cause: TripCause::VoltageLimit,
            begin: |w| w.command.volts[0] = f64::NAN,
            end: |w| w.command.volts[0] = 0.0,
            within: [1, 1],
        },
        Fault {
            cause: TripCause::VoltageLimit,
            begin: |w| w.sample.motor_v[0] = 5.01,
            end: |w| w.sample.motor_v[0] = 0.0,
            within: [1, 1],
        },
        Fault {
            cause: TripCause::VoltageLimit,
            begin: |w| w.sample.output_v[2] = 0.1,
            end: |w| w.sample.output_v[2] = 0.0,
            within: [1, 1],
        },
        Fault {
            cause: TripCause::TorqueLimit,
            begin: |w| w.sample.slave_torque[0] = -10.1,
            end: |w| w.sample.slave_torque[0] = 0.0,
            within: [1, 1],
        },
    ]
}

/// A sensor reports what cannot be.
fn sensor_faults() -> Vec<Fault> {
    vec![
        Fault {
            cause: TripCause::EncoderJump,
            begin: |w| w.sample.master_counts[0] += 21,
            end: once,
            within: [1, 1],
        },
        Fault {
            cause: TripCause::EncoderJump,
            begin: |w| w.sample.slave_counts[0] = i64::MIN,
            end: |w| w.sample.slave_counts[0] = 0,
            within: [1, 1],
        },
        Fault {
            cause: TripCause::HomingLost,
            begin: |w| {
                w.sample.homed = 0;
                w.sample.homing_sequence += 1;
            },
            end: |w| w.sample.homed = 1,
            within: [1, 1],
        },
        Fault {
            cause: TripCause::SensorInvalid,
            begin: |w| w.sample.master_present = 0,
            end: |w| w.sample.master_present = 1,
            within: [1, 1],
        },
        Fault {
            cause: TripCause::SensorInvalid,
            begin: |w| w.sample.slave_present = 0,
            end: |w| w.sample.slave_present = 1,
            within: [1, 1],
        },
        Fault {
            cause: TripCause::SensorRailed,
            begin: |w| w.sample.analog_v[0] = -9.96,
            end: |w| w.sample.analog_v[0] = 0.0,
            within: [22, 22],
        },
        Fault {
            cause: TripCause::SensorInvalid,
            begin: |w| w.sample.slave_position[0] = f64::NAN,
            end: |w| w.sample.slave_position[0] = 0.0,
            within: [1, 1],
        },
        Fault {
            cause: TripCause::SensorInvalid,
            begin: |w| w.sample.slave_torque[0] = f64::INFINITY,
            end: |w| w.sample.slave_torque[0] = 0.0,
            within: [1, 1],
        },
        Fault {
            cause: TripCause::SensorInvalid,
            begin: |w| w.sample.analog_v[0] = f64::NAN,
            end: |w| w.sample.analog_v[0] = 0.0,
            within: [1, 1],
        },
    ]
}

/// A loop runs other than it should.
fn flow_faults() -> Vec<Fault> {
    vec![
        Fault {
            cause: TripCause::ProgramFlow,
            begin: |w| w.flows[0].retain(|&step| step != Checkpoint::GateStepped),
            end: |w| w.flows[0] = ACQUISITION_CYCLE.to_vec(),
            within: [2, 2],
        },
        Fault {
            cause: TripCause::ProgramFlow,
            begin: |w| w.flows[1].swap(0, 2),
            end: |w| w.flows[1] = CONTROL_CYCLE.to_vec(),
            within: [2, 2],
        },
        Fault {
            cause: TripCause::TooFast,
            begin: |w| {
                for _ in 0..8 {
                    w.now += MS / 4;
                    w.sample_now();
                    w.command_now();
                }
                w.step();
            },
            end: once,
            within: [1, 1],
        },
    ]
}

/// The launcher, the clock or the session is wrong.
fn session_faults() -> Vec<Fault> {
    vec![
        Fault {
            cause: TripCause::LauncherLost,
            begin: |w| w.peers.launcher_alive = false,
            end: |w| w.peers.launcher_alive = true,
            within: [1, 1],
        },
        Fault {
            cause: TripCause::WatchdogLate,
            begin: |w| w.now += 41 * MS,
            end: once,
            within: [1, 1],
        },
        Fault {
            cause: TripCause::WatchdogLate,
            begin: |w| w.now -= 3 * MS,
            end: |w| w.now += 9 * MS,
            within: [1, 1],
        },
        Fault {
            cause: TripCause::SessionMismatch,
            begin: |w| w.interlock.observe_sample(&Sample { session: 12, ..w.sample }),
            end: once,
            within: [1, 1],
        },
        Fault {
            cause: TripCause::SessionMismatch,
            begin: |w| w.interlock.observe_command(&MotorCommand { session: 12, ..w.command }),
            end: once,
            within: [1, 1],
        },
    ]
}

#[test]
fn sr_11_fault_table() {
    for (column, profile) in [Profile::Realtime, Profile::BestEffort].into_iter().enumerate() {
        for (row, fault) in faults().enumerate() {
            for (before, after) in [
                (WatchdogState::Disarmed, WatchdogState::Faulted),
                (WatchdogState::Armed, WatchdogState::Tripped),
                (WatchdogState::Enabled, WatchdogState::Tripped),
                (WatchdogState::Tripped, WatchdogState::Tripped),
                (WatchdogState::Faulted, WatchdogState::Faulted),
            ] {
                let what = format!("row {row}: {} from {before}, {profile}", fault.cause);
                let mut world = World::in_state(profile, before);
                (fault.begin)(&mut world);
                let mut refused = false;
                let mut was_active = false;
                for _ in 0..fault.within[column] {
                    world.cycle();
                    if world.interlock.active_faults().contains(fault.cause) {
                        was_active = true;
                        refused |= matches!(world.verb(Verb::Reset), Err(Refusal::FaultActive(_)));
                    }
                }
                assert!(was_active, "{what}: the token does not show it");
                assert_eq!(world.interlock.state(), after, "{what}");
                if before != after {
                    assert_eq!(world.interlock.cause(), fault.cause, "{what}");
                }
                assert!(refused, "{what}: reset while active");
                // It goes away: nothing happens by itself, and then a person can bring the rig
                // back.
                (fault.end)(&mut world);
                world.cycles(200);
                assert_eq!(world.interlock.state(), after, "{what}: left the state by itself");
                assert!(matches!(world.verb(Verb::Enable), Err(Refusal::State { .. })), "{what}");
                for verb in [Verb::Reset, Verb::Arm, Verb::Enable] {
                    world
                        .verb(verb)
                        .unwrap_or_else(|refusal| panic!("{what}: {verb:?}: {refusal}"));
                }
                world.cycles(50);
                assert_eq!(world.interlock.state(), WatchdogState::Enabled, "{what}");
            }
        }
    }
}

//! Messages of the experiment process: its setpoints, and what it says of a protocol in progress,
//! in one list with the macro of the others.

use crate::message::messages;
use crate::{ANALOG, AXES, BARS, MATRIX, TABLES};

messages! {
    /// Where the handle shall go, from the experiment or the operator; holds until its lease
    /// lapses.
    Setpoint v5 {
        /// the instant that position, velocity and acceleration are meant for [ns, CLOCK_MONOTONIC]
        at_ns: u64,
        /// until when it may be followed [ns, CLOCK_MONOTONIC]
        lease_until_ns: u64,
        /// identity of the protocol (hash of its text)
        protocol: u64,
        /// homing_sequence of the samples in whose positions it is given
        homing_sequence: u64,
        /// position (rad or m)
        position: [f64; AXES],
        /// velocity (rad/s or m/s)
        velocity: [f64; AXES],
        /// acceleration (rad/s² or m/s²)
        acceleration: [f64; AXES],
        /// peak speed of the movement that it is part of, for the shape of the friction
        /// feed-forward; 0 where none (rad/s or m/s)
        peak_speed: [f64; AXES],
        /// force field of mode impedance: stiffness about `position`, row by row; torque = -
        /// stiffness (position - centre) (N·m/rad or N/m)
        stiffness: [f64; MATRIX],
        /// force field: damping, row by row; torque = - damping velocity (N·m·s/rad or N·s/m)
        damping: [f64; MATRIX],
        /// force field: inertia, row by row; torque = - inertia acceleration (kg·m² or kg)
        inertia: [f64; MATRIX],
        /// force field: torque at evenly spaced positions from `table_position_min` to
        /// `table_position_max`, axis by axis (N·m or N)
        position_table: [f64; TABLES],
        /// force field: torque at evenly spaced velocities from - `table_speed` to + `table_speed`,
        /// axis by axis (N·m or N)
        velocity_table: [f64; TABLES],
        /// force field: position of the first entry of `position_table` (rad or m)
        table_position_min: [f64; AXES],
        /// force field: position of its last entry; no table where not above the first (rad or m)
        table_position_max: [f64; AXES],
        /// force field: speed of the last entry of `velocity_table`; no table where not positive
        /// (rad/s or m/s)
        table_speed: [f64; AXES],
        /// force field: where the lower wall begins (rad or m)
        wall_min: [f64; AXES],
        /// force field: where the upper wall begins (rad or m)
        wall_max: [f64; AXES],
        /// force field: stiffness of the walls; 0 where there are none (N·m/rad or N/m)
        wall_stiffness: [f64; AXES],
        /// the output stays within ± this, where it is below the rig's own limit; 0 for the rig's
        /// (V)
        output_limit_v: [f64; AXES],
        /// the time that the player was given in this cycle; 0 where the sender does not say from
        /// what it computed, as for all fields down to `run` [ns, CLOCK_MONOTONIC]
        player_ns: u64,
        /// tick of the newest sample that the experiment had
        sample_tick: u64,
        /// scan time of that sample; 0 before the first [ns, CLOCK_MONOTONIC]
        sample_time_ns: u64,
        /// samples that the experiment has received since it started
        samples_received: u64,
        /// sender of the newest token that the experiment had; 0 before the first
        token_incarnation: u64,
        /// sequence of that token
        token_sequence: u64,
        /// sender of the newest event of the scanner's line that the experiment had; 0 before the
        /// first
        pulse_incarnation: u64,
        /// sequence of that event
        pulse_sequence: u64,
        /// events of the scanner's line that the experiment has received since it started
        pulses_received: u64,
        /// pulses typed as the key 5 that the experiment has received since it started
        keys_received: u64,
        /// results of learning that the player has received since the experiment started
        results_received: u64,
        /// when the client renewed its lease on the protocol, as the player was told; 0: not yet
        /// [ns, CLOCK_MONOTONIC]
        renewed_ns: u64,
        /// since when the player supervises this run of the protocol [ns, CLOCK_MONOTONIC]
        run_ns: u64,
        /// enable epoch that the run belongs to
        epoch: u64,
        /// number of the newest order that the experiment took
        order: u32,
        /// number of the order with which the run began; 0 for one that goes on after a restart of
        /// the experiment
        run: u32,
        /// index of the protocol's segment
        segment: u32,
        /// number of segments
        segments: u32,
        /// Mode
        mode: u8 = Mode,
        /// Process that owns the setpoint: experiment or operator
        owner: u8 = Process,
        /// axes that it means
        axes: u8,
        /// 1 where the run began in the segment in which it was interrupted before
        continued: u8,
        /// none
        reserved: [u8; 4],
    }

    /// The zero that a search has found for an axis, from the experiment to acquisition; repeated
    /// until samples show it.
    HomeOrder v1 {
        /// homing_sequence of the samples that it was computed from
        homing_sequence: u64,
        /// count of the master's encoder at position 0
        master_zero: i64,
        /// count of the slave's encoder at position 0; no meaning without a slave encoder
        slave_zero: i64,
        /// index of the axis
        axis: u8,
        /// none
        reserved: [u8; 7],
    }

    /// A session begins: the experiment asks acquisition for a pulse on the rig's digital output.
    SyncOrder v1 {
        /// when the session began [ns, CLOCK_MONOTONIC]
        at_ns: u64,
        /// number of the session, from 1
        number: u32,
        /// index of the protocol's segment
        segment: u32,
    }

    /// A volume of the scan that a protocol counts; again when a count changes before the next one,
    /// and after a restart of the experiment process from the segment's beginning on.
    Volume v1 {
        /// its number, from 0
        index: u64,
        /// when it began [ns, CLOCK_MONOTONIC]
        at_ns: u64,
        /// number of volumes that the protocol expects; 0 where it does not say
        expected: u64,
        /// volumes with a pulse so far
        volumes: u64,
        /// volumes without one so far, between two that have one
        missed: u64,
        /// pulses so far that belong to no volume
        spurious: u64,
        /// pulses so far after the last volume
        surplus: u64,
        /// how often the scanner was started anew
        restarts: u64,
        /// repetition time, as the pulses show it (s)
        repetition_s: f64,
        /// VolumeSource
        source: u8 = VolumeSource,
        /// none
        reserved: [u8; 7],
    }

    /// Sums of a session's effort, and the bar that the subject sees: 50 a second, in a protocol
    /// that has sessions. Between sessions the sums are those of the last one.
    Performance v1 {
        /// instant of the sums, on a grid of 20 ms from the segment's beginning, or the end of a
        /// session: they hold the samples before it [ns, CLOCK_MONOTONIC]
        at_ns: u64,
        /// when the segment began [ns, CLOCK_MONOTONIC]
        begun_ns: u64,
        /// planned duration of the segment (s)
        planned_s: f64,
        /// sum over the session's samples of the magnitude of the hand's torque (N·m or N)
        torque_sum: [f64; AXES],
        /// sums over the session's samples of the activity of agonists and antagonists, in the unit
        /// of their channels
        emg_sum: [f64; BARS],
        /// samples in the sums
        samples: u64,
        /// samples of the session that are missing in the sums
        samples_missed: u64,
        /// what the bar's last update compares with its target: mean torque (N·m or N), or activity
        /// of agonists and antagonists
        value: [f64; BARS],
        /// what the middle of each bar stands for; 0 where there is no target yet
        target: [f64; BARS],
        /// height of each bar, 0 to 19 of 20
        height: [f64; BARS],
        /// index of the segment
        segment: u32,
        /// number of the session that runs or ran last, from 1; 0 before the first
        number: u32,
        /// number of sessions
        sessions: u32,
        /// updates of the bar since the session, or the rest, began
        update: u32,
        /// bars shown: 0 where there is none to be seen
        bars: u8,
        /// Light
        light: u8 = Light,
        /// 1 while the bar repeats the last session
        replay: u8,
        /// none
        reserved: [u8; 5],
    }

    /// A session that has ended.
    SessionResult v1 {
        /// when it began [ns, CLOCK_MONOTONIC]
        begun_ns: u64,
        /// when it ended: its sums hold the samples from the one to the other [ns, CLOCK_MONOTONIC]
        ended_ns: u64,
        /// planned duration (s)
        planned_s: f64,
        /// sum over its samples of the magnitude of the hand's torque (N·m or N)
        torque_sum: [f64; AXES],
        /// sums over its samples of the activity of agonists and antagonists, in the unit of their
        /// channels
        emg_sum: [f64; BARS],
        /// samples in the sums
        samples: u64,
        /// samples of the session that are missing in the sums
        samples_missed: u64,
        /// what the next session has to match: mean torque (N·m or N), or mean activity of agonists
        /// and antagonists; 0 where the protocol matches nothing
        value: [f64; BARS],
        /// what this session had to match; 0 for the first
        target: [f64; BARS],
        /// index of the segment
        segment: u32,
        /// number of the session, from 1
        number: u32,
        /// number of sessions
        sessions: u32,
        /// SessionOutcome
        outcome: u8 = SessionOutcome,
        /// values that sessions match: 1 torque, 2 activities; 0 where they match nothing
        bars: u8,
        /// none
        reserved: [u8; 2],
    }

    /// Maxima of the muscles' activity: measured in a contraction, or taken from an earlier
    /// measurement by a protocol that uses them.
    EmgMaximum v1 {
        /// when the contraction began; when the protocol began that uses them [ns, CLOCK_MONOTONIC]
        begun_ns: u64,
        /// when the contraction ended; as `begun_ns` for those that are used [ns, CLOCK_MONOTONIC]
        ended_ns: u64,
        /// largest mean over 0.5 s of the rectified signal at each input of the card, in the unit
        /// of its channel; 0 where there is none
        maximum: [f64; ANALOG],
        /// index of the segment
        segment: u32,
        /// number of the session, from 1
        number: u32,
        /// inputs that have one, one bit each
        inputs: u16,
        /// 1 where the activity of the protocol is a share of them; 0 where they were measured
        used: u8,
        /// none
        reserved: [u8; 5],
    }
}

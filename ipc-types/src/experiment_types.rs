//! Messages of the experiment process about a protocol in progress, in one list with the macro of
//! the others.

use crate::message::messages;
use crate::{ANALOG, AXES, BARS};

messages! {
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

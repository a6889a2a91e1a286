//! The messages that monitor the processes: heartbeat, loop timing, loss, clock.

use crate::message::message;

message! {
    /// Sign of life of a slow process, 20 Hz.
    Heartbeat, "farreach.Heartbeat.v1", "farreach/msg/Heartbeat" {
        /// messages lost on the way to this process since it started
        lost: u64,
        /// messages waiting in its own queue
        queued: u64,
        /// operating system's process id
        pid: u32,
        /// Process
        source: u8 = Process,
        /// state, its meaning depends on the process (logger: 1 recording; experiment: 1 running)
        state: u8,
        /// Profile
        profile: u8 = Profile,
        /// none
        reserved: u8,
    }
}

message! {
    /// How punctual a periodic process was, once a second: over the last second, and since it
    /// started; and what it missed or could not hand on.
    LoopTiming, "farreach.LoopTiming.v2", "farreach/msg/LoopTiming" {
        /// period of the loop (ns)
        period_ns: u64,
        /// phase of the loop within its period (ns)
        phase_ns: u64,
        /// cycles run since start
        cycles: u64,
        /// periods skipped since start because it woke late
        missed_periods: u64,
        /// wake lateness over the last second: p50, p99, p99.9, max (ns)
        wake_late_ns: [u64; 4],
        /// execution time over the last second: p50, p99, p99.9, max (ns)
        execution_ns: [u64; 4],
        /// wake lateness since start: p50, p99, p99.9, max (ns)
        total_wake_late_ns: [u64; 4],
        /// execution time since start: p50, p99, p99.9, max (ns)
        total_execution_ns: [u64; 4],
        /// operating system's process id
        pid: u32,
        /// Process
        source: u8 = Process,
        /// Profile
        profile: u8 = Profile,
        /// 1 if memory is locked
        memory_locked: u8,
        /// 1 if idle processors are kept awake
        kept_awake: u8,
        /// messages of other processes that are missing in their sequence, since start
        lost: u64,
        /// messages of other processes whose sequence repeated or went backwards, since start
        out_of_turn: u64,
        /// senders that died while they were being connected, since start
        connections_failed: u64,
        /// own messages that a subscriber did not get because its connection is broken, since start
        undelivered: u64,
        /// what found a queue between the process's own threads full, since start
        dropped: u64,
        /// setpoints that control did not follow, since start
        refused: u64,
    }
}

message! {
    /// What the logger got, lost and wrote of one topic, once a second.
    LossCounters, "farreach.LossCounters.v1", "farreach/msg/LossCounters" {
        /// messages received since the logger started
        received: u64,
        /// messages that never reached the logger (gaps in the sequence)
        gaps: u64,
        /// messages dropped because the logger's own queue to the disk was full
        dropped: u64,
        /// messages written to the present recording
        written: u64,
        /// messages that the disk refused
        refused: u64,
        /// index of the topic in the table of topics
        topic: u32,
        /// none
        reserved: u32,
    }
}

message! {
    /// Monotonic against wall clock, once a second.
    ClockSync, "farreach.ClockSync.v1", "farreach/msg/ClockSync" {
        /// CLOCK_MONOTONIC at the middle of the measurement (ns)
        monotonic_ns: u64,
        /// CLOCK_REALTIME at the same instant (ns since 1970)
        realtime_ns: u64,
        /// realtime minus monotonic as fixed at the start of the recording (ns)
        file_offset_ns: i64,
        /// half the time that the measurement took (ns)
        uncertainty_ns: u64,
    }
}

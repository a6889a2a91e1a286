//! The messages, all of them in one list. The macro puts four identity fields before those written
//! here: session (drawn by the keeper at each cold start), incarnation (drawn at each process
//! start), sequence (from 0, per incarnation and topic), and the time of publishing.

use crate::message::messages;
use crate::{ANALOG, AXES, TEXT};

messages! {
    /// One scan of the card, converted, with what the gate wrote: the rig's main signal.
    Sample v6 {
        /// tick of the acquisition grid at which the card took the scan (monotonic ns / period)
        tick: u64,
        /// when the card took the scan [ns, CLOCK_MONOTONIC]
        scan_time_ns: u64,
        /// time within the record that is replayed (s); 0 for a live card
        record_time_s: f64,
        /// encoder counts of the master
        master_counts: [i64; AXES],
        /// encoder counts of the slave
        slave_counts: [i64; AXES],
        /// count of the master's encoder at position 0: found by homing, or the count at power-up
        /// while the axis is unhomed
        master_zero: [i64; AXES],
        /// count of the slave's encoder at position 0
        slave_zero: [i64; AXES],
        /// rises whenever a zero changes, or an axis becomes homed or unhomed; 0 for absolute
        /// encoders
        homing_sequence: u64,
        /// position of the master, from its zero (rad or m)
        master_position: [f64; AXES],
        /// position of the slave, from its zero (rad or m)
        slave_position: [f64; AXES],
        /// torque (or force) that the hand applies to the slave, positive when it drives the slave
        /// positive (N·m or N)
        slave_torque: [f64; AXES],
        /// analog inputs as read (V)
        analog_v: [f64; ANALOG],
        /// volts that reached the motor when the card took this scan (read back, or from the
        /// replayed record): 0 while motor power is off (V)
        motor_v: [f64; AXES],
        /// volts that the gate wrote in this cycle: 0 where the card refused the write (V)
        output_v: [f64; AXES],
        /// enable epoch that the gate last saw
        epoch: u64,
        /// sequence of the newest token that the gate saw (challenge and response)
        token_sequence: u64,
        /// incarnation of the control that sent the newest command that the gate saw
        command_incarnation: u64,
        /// sequence of the newest command that the gate saw
        command_sequence: u64,
        /// scans that the card or its FIFO dropped since this incarnation began
        scans_missed: u64,
        /// cycles of acquisition that were skipped because it woke late
        cycles_missed: u64,
        /// the time that the gate was given in this cycle [ns, CLOCK_MONOTONIC]
        gate_ns: u64,
        /// cycles of the gate since this incarnation began, this one included
        gate_cycles: u64,
        /// digital inputs, one bit each
        digital_in: u32,
        /// digital outputs when the card took this scan, one bit each
        digital_out: u32,
        /// analog channels present, one bit each
        analog_present: u16,
        /// signature of the checkpoints that acquisition's cycle has passed, with token_sequence as
        /// the challenge
        flow: u16,
        /// axes of the rig
        axes: u8,
        /// master encoders present, one bit per axis
        master_present: u8,
        /// slave encoders present, one bit per axis
        slave_present: u8,
        /// torque channels present, one bit per axis
        torque_present: u8,
        /// motor volts present, one bit per axis
        motor_present: u8,
        /// GateState
        gate_state: u8 = GateState,
        /// GateCause of the last epoch that the gate ended
        gate_cause: u8 = GateCause,
        /// CardKind
        backend: u8 = CardKind,
        /// Profile that acquisition was granted
        profile: u8 = Profile,
        /// 1 if the card reports the motor power on (enable line alive)
        motor_power: u8,
        /// axes whose positions are absolute, one bit each
        homed: u8,
        /// 1 if the simulated card filled the scan in: it had not been run in time, and simulated
        /// this tick a period or more after scan_time_ns; 0 for every other card
        filled_in: u8,
    }

    /// Volts for the motors, from control.
    MotorCommand v4 {
        /// tick of the sample that it was computed from
        sample_tick: u64,
        /// scan time of that sample [ns, CLOCK_MONOTONIC]
        sample_time_ns: u64,
        /// when it was computed [ns, CLOCK_MONOTONIC]
        computed_ns: u64,
        /// sequence of the newest token that control saw (challenge and response)
        token_sequence: u64,
        /// enable epoch that control believes in
        epoch: u64,
        /// sequence of the setpoint that was followed
        setpoint_sequence: u64,
        /// sender of the setpoint that control held, followed or not; 0 before the first
        held_incarnation: u64,
        /// sequence of the setpoint that control held
        held_sequence: u64,
        /// motor volts (V)
        volts: [f64; AXES],
        /// the part of them that is feed-forward (V)
        feedforward_v: [f64; AXES],
        /// reference position (rad or m)
        reference_position: [f64; AXES],
        /// reference velocity (rad/s or m/s)
        reference_velocity: [f64; AXES],
        /// filtered velocity estimate of the master (rad/s or m/s)
        velocity: [f64; AXES],
        /// control cycles that were skipped because it woke late
        cycles_missed: u64,
        /// factor on the feedback: below 1 while control answers late (1)
        feedback_factor: f64,
        /// Mode
        mode: u8 = Mode,
        /// axes of the rig
        axes: u8,
        /// 1 while the output limit acts, or a missing or non-finite value keeps the output at 0 V
        limited: u8,
        /// 1 while ramping from the measured position to the setpoint
        ramping: u8,
        /// 1 if the setpoint's lease has expired, or the setpoint cannot be used (not finite)
        lapsed: u8,
        /// Profile that control was granted
        profile: u8 = Profile,
        /// signature of the checkpoints that control's cycle has passed, with token_sequence as
        /// the challenge
        flow: u16,
    }

    /// The watchdog's permission to power the motor, for a few milliseconds.
    EnableToken v4 {
        /// enable epoch: rises with every enable, also over restarts of the watchdog
        epoch: u64,
        /// incarnation of the watchdog that issued it
        watchdog_incarnation: u64,
        /// incarnation of the acquisition that it was issued for
        acquisition_incarnation: u64,
        /// incarnation of the control that it was issued for
        control_incarnation: u64,
        /// when it was issued [ns, CLOCK_MONOTONIC]
        issued_ns: u64,
        /// until when it holds [ns, CLOCK_MONOTONIC]
        valid_until_ns: u64,
        /// tick of the newest sample that the watchdog saw
        sample_tick: u64,
        /// sequence of the newest command that the watchdog saw
        command_sequence: u64,
        /// samples that the watchdog has received since it started
        samples_received: u64,
        /// commands that the watchdog has received since it started
        commands_received: u64,
        /// active faults, one bit for each TripCause
        faults: u64,
        /// watchdog cycles that were skipped because it woke late
        cycles_missed: u64,
        /// 1 if the motor may be powered
        enabled: u8,
        /// WatchdogState
        state: u8 = WatchdogState,
        /// TripCause of the last fault or trip
        cause: u8 = TripCause,
        /// Profile that the watchdog was granted
        profile: u8 = Profile,
        /// axes that the watchdog takes as homed, one bit each: on the others its limits are those
        /// of homing
        homed: u8,
        /// axes for which the rig file gives a range of motion of the subject, one bit each
        range_given: u8,
        /// of them those for which it is in force: homed, and not on the way of a search for the
        /// stops, one bit each
        range_supervised: u8,
        /// code of the Verb that was executed in this cycle, plus 1; 0 for none
        verb: u8,
    }

    /// The watchdog's digital output: the card drops the motor when it stops toggling.
    EnableLine v1 {
        /// enable epoch
        epoch: u64,
        /// how often the level changed since the watchdog started; the level is its lowest bit
        toggles: u64,
    }

    /// One scan from the simulated card's FIFO, from card to acquisition; recorded as evidence of
    /// what the motor really got. Where the time of publishing is a period or more after
    /// scan_time_ns, the card had not been run in time, and filled the scan in.
    CardScan v2 {
        /// tick of the acquisition grid
        tick: u64,
        /// when the card took the scan [ns, CLOCK_MONOTONIC]
        scan_time_ns: u64,
        /// highest tick that acquisition has taken out of the FIFO and published
        taken_tick: u64,
        /// encoder counts of the master; -2^63 for an encoder that does not answer
        master_counts: [i64; AXES],
        /// encoder counts of the slave; -2^63 for an encoder that does not answer
        slave_counts: [i64; AXES],
        /// analog inputs (V)
        analog_v: [f64; ANALOG],
        /// volts that the DACs hold (V)
        dac_v: [f64; AXES],
        /// volts that reach the motor: those of the DACs while motor power is on, else 0 (V)
        motor_v: [f64; AXES],
        /// sequence of the newest CardOutput that the card got
        output_sequence: u64,
        /// incarnation of the acquisition that wrote it
        output_incarnation: u64,
        /// age of the enable line's last toggle (ns)
        line_age_ns: u64,
        /// digital inputs, one bit each
        digital_in: u32,
        /// 1 while the enable line is alive
        motor_power: u8,
        /// axes of the rig
        axes: u8,
        /// Profile that the simulator was granted
        profile: u8 = Profile,
        /// digital outputs, one bit each
        digital_out: u8,
    }

    /// What acquisition writes to the simulated card.
    CardOutput v2 {
        /// volts for the DACs (V)
        volts: [f64; AXES],
        /// highest tick that acquisition has taken out of the FIFO and published
        taken_tick: u64,
        /// digital outputs, one bit each
        digital_out: u32,
        /// none
        reserved: u32,
    }

    /// Something happened on the scanner's trigger line, or the key 5 was typed for a pulse.
    ScannerPulse v1 {
        /// when the line crossed into its new state, interpolated between two scans, or when the
        /// key was pressed [ns, CLOCK_MONOTONIC]
        at_ns: u64,
        /// tick of the scan that showed it; 0 for the key
        tick: u64,
        /// pulses since this acquisition began, or this experiment process for the key
        pulses: u64,
        /// levels since this acquisition began that were too short for a pulse
        glitches: u64,
        /// LineEvent
        kind: u8 = LineEvent,
        /// none
        reserved: [u8; 7],
    }

    /// Something happened that a person or an analysis wants to know.
    Event v1 {
        /// first value; its meaning depends on the kind
        a: f64,
        /// second value
        b: f64,
        /// third value
        c: f64,
        /// EventKind
        kind: u8 = EventKind,
        /// Severity
        severity: u8 = Severity,
        /// Process that sends it
        source: u8 = Process,
        /// length of the text (bytes)
        text_len: u8,
        /// index of the protocol's segment, where there is one
        segment: u32,
        /// text, UTF-8, zero-padded
        text: [u8; TEXT],
    }

    /// Sign of life of logger, experiment and console, 20 Hz.
    Heartbeat v1 {
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

    /// How punctual a periodic process was, once a second: over the last second, and since it
    /// started; and what it missed or could not hand on.
    LoopTiming v2 {
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

    /// What the logger got, lost and wrote of one topic, once a second.
    LossCounters v1 {
        /// messages received since the logger started
        received: u64,
        /// messages that never reached the logger (gaps in the sequence)
        gaps: u64,
        /// messages dropped because the logger's own queue to the disk was full
        dropped: u64,
        /// messages written to the present recording
        written: u64,
        /// messages that were not written: the file could not be opened or written, or the message
        /// has the wrong length
        refused: u64,
        /// index of the topic in the table of topics
        topic: u32,
        /// none
        reserved: u32,
    }

    /// Monotonic against wall clock, once a second.
    ClockSync v1 {
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

impl Sample {
    /// Torque of the hand on each axis (N·m or N), 0 for an axis without a sensor; `None` where one
    /// is not finite.
    pub fn hand_torques(&self) -> Option<[f64; AXES]> {
        let present = |axis: usize| self.torque_present & 1 << axis != 0;
        let torques: [f64; AXES] =
            std::array::from_fn(|axis| if present(axis) { self.slave_torque[axis] } else { 0.0 });
        torques.iter().all(|torque| torque.is_finite()).then_some(torques)
    }
}

impl Event {
    /// An event of `kind` from `source`; the text is cut at a character's edge when too long.
    pub fn new(
        source: crate::Process,
        kind: crate::EventKind,
        severity: crate::Severity,
        text: &str,
    ) -> Self {
        let mut event = Self {
            kind: kind.code(),
            severity: severity.code(),
            source: source.code(),
            ..Self::default()
        };
        let mut end = text.len().min(TEXT);
        while !text.is_char_boundary(end) {
            end -= 1;
        }
        event.text[..end].copy_from_slice(&text.as_bytes()[..end]);
        event.text_len = end as u8;
        event
    }

    /// The text; empty where it is not UTF-8.
    pub fn text(&self) -> &str {
        self.text
            .get(..usize::from(self.text_len))
            .and_then(|bytes| std::str::from_utf8(bytes).ok())
            .unwrap_or_default()
    }
}

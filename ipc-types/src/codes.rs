//! The codes that messages carry as `u8`.

/// Defines enumerations whose values messages carry as `u8`: `Variant = code, "in words";`, the
/// meaning as documentation.
macro_rules! codes {
    ($(
        $(#[doc = $doc:literal])+
        $name:ident {
            $($(#[doc = $vdoc:literal])+ $(#[serde($serde:meta)])? $variant:ident = $value:literal,
                $text:literal;)+
        }
    )+) => {$(
        $(#[doc = $doc])+
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        #[derive(serde::Serialize, serde::Deserialize)]
        #[serde(rename_all = "snake_case")]
        #[repr(u8)]
        pub enum $name { $($(#[doc = $vdoc])+ $(#[serde($serde)])? $variant = $value,)+ }

        impl $name {
            /// All values, in order.
            pub const ALL: &'static [Self] = &[$(Self::$variant),+];

            /// All values with their names and words, for schemas and screens.
            pub const CODES: &'static [crate::Code] = &[$(crate::Code {
                value: $value,
                name: stringify!($variant),
                text: $text,
            }),+];

            /// The code in a message.
            pub const fn code(self) -> u8 { self as u8 }

            /// The value of a code; `None` for a code that this build does not know.
            pub const fn from_code(code: u8) -> Option<Self> {
                match code { $($value => Some(Self::$variant),)+ _ => None }
            }

            /// What the value means, in a sentence: its documentation.
            pub const fn about(self) -> &'static str {
                match self { $(Self::$variant => concat!($($vdoc),+).trim_ascii(),)+ }
            }

            /// In words, for screens and messages.
            pub const fn text(self) -> &'static str {
                match self { $(Self::$variant => $text,)+ }
            }
        }

        impl std::fmt::Display for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.pad(self.text())
            }
        }
    )+};
}

pub(crate) use codes;

codes! {
    /// State of the gate, where acquisition writes the DAC.
    GateState {
        /// Writes 0 V; no enable epoch is open.
        Closed = 0, "closed";
        /// The command's volts pass.
        Open = 1, "open";
        /// Writes 0 V; latched closed by a violation until a higher enable epoch.
        #[serde(rename = "burnt")]
        LatchedClosed = 2, "latched closed";
    }

    /// Why the gate closed and ended an enable epoch.
    GateCause {
        /// Nothing was wrong so far.
        None = 0, "none";
        /// The watchdog withdrew the enable in good order.
        Withdrawn = 1, "enable withdrawn";
        /// No token in time: it expired, or none came.
        TokenStale = 2, "token stale";
        /// The token's sequence went backwards.
        TokenBackwards = 3, "token went backwards";
        /// The token is of another session.
        TokenSession = 4, "token of another session";
        /// The token's sender is not the one that it names, or changed within the epoch.
        TokenSender = 5, "token from an unexpected sender";
        /// The token was issued for another acquisition.
        TokenReceiver = 6, "token for another acquisition";
        /// The token claims to be issued in the future, or to live longer than allowed.
        TokenTime = 7, "token with an impossible time";
        /// No command in time.
        CommandStale = 8, "command stale";
        /// The command's sequence, or the sample that it answers, went backwards.
        CommandBackwards = 9, "command went backwards";
        /// The command is of another session.
        CommandSession = 10, "command of another session";
        /// The command's sender is not the one that the token names.
        CommandSender = 11, "command from an unexpected sender";
        /// The command holds a value that is not finite.
        CommandNotFinite = 12, "command is not finite";
        /// The command is beyond the output limit.
        CommandRange = 13, "command beyond the output limit";
        /// The command was computed from a sample that is too old.
        CommandSampleOld = 14, "command computed from an old sample";
        /// The command claims to come from the future.
        CommandTime = 15, "command with an impossible time";
        /// The gate itself was not run in time.
        GateLate = 16, "gate ran late";
        /// The card refused a write.
        WriteFailed = 17, "card refused the write";
        /// Epochs went backwards.
        EpochBackwards = 18, "epoch went backwards";
    }

    /// State of the watchdog.
    WatchdogState {
        /// A fault is active, or was since the last reset; no power.
        Faulted = 0, "faulted";
        /// No fault, no power.
        Disarmed = 1, "disarmed";
        /// Checked and ready; no power.
        Armed = 2, "armed";
        /// Powered.
        Enabled = 3, "enabled";
        /// Power was cut by a fault or by `estop`; latched until `reset`.
        Tripped = 4, "tripped";
    }

    /// Why the watchdog faulted or tripped.
    TripCause {
        /// Nothing was wrong so far.
        None = 0, "none";
        /// The watchdog has just started.
        Started = 1, "watchdog started";
        /// A person asked for it.
        EmergencyStop = 2, "emergency stop";
        /// No sample in time.
        AcquisitionLost = 3, "acquisition lost";
        /// No command in time.
        ControlLost = 4, "control lost";
        /// Acquisition was restarted.
        AcquisitionChanged = 5, "acquisition restarted";
        /// Control was restarted or replaced.
        ControlChanged = 6, "control restarted";
        /// The gate latched closed and ended the epoch.
        #[serde(rename = "gate_burnt")]
        GateLatched = 7, "gate closed, re-enable required";
        /// The gate did not open in time.
        GateNotOpen = 8, "gate did not open";
        /// The command answers a sample that is too old, or comes too late.
        CommandStale = 9, "command stale";
        /// The command's sequence or sample went backwards.
        CommandBackwards = 10, "command went backwards";
        /// Sample sequence or tick went backwards.
        SampleBackwards = 11, "sample went backwards";
        /// Position beyond its limit.
        PositionLimit = 12, "position limit";
        /// Speed beyond its limit.
        SpeedLimit = 13, "speed limit";
        /// Volts beyond the limit.
        VoltageLimit = 14, "voltage limit";
        /// Torque beyond its limit.
        TorqueLimit = 15, "torque limit";
        /// The encoder moved further in one tick than the machine can.
        EncoderJump = 16, "encoder jump";
        /// A measured value is not finite, or a channel that is needed is absent.
        SensorInvalid = 17, "sensor invalid";
        /// The launcher is gone: nobody would restart what dies.
        LauncherLost = 18, "launcher lost";
        /// The watchdog itself was not run in time.
        WatchdogLate = 19, "watchdog ran late";
        /// A real card and no real-time scheduling.
        NotRealtime = 20, "real card without real-time scheduling";
        /// A message of another session.
        SessionMismatch = 21, "message of another session";
        /// Token echo missing: acquisition or control do not read our tokens.
        EchoLost = 22, "token echo lost";
        /// The keeper is gone.
        KeeperLost = 23, "keeper lost";
        /// Acquisition's card has no outputs (a replayed record, no card).
        NoOutput = 24, "no output behind acquisition";
        /// An encoder lost its zero: the card was restarted, or its count jumped.
        HomingLost = 25, "homing lost";
        /// An axis was powered for too long without being homed.
        HomingTime = 26, "not homed in time";
        /// Samples or commands come faster than their rate.
        TooFast = 27, "messages come too fast";
        /// A loop has left out a step of its cycle, or run its steps in another order.
        ProgramFlow = 28, "program flow broken";
        /// Master and slave are far from the reference.
        FollowingError = 29, "following error";
        /// One side moves and the encoder of the other counts nothing.
        EncoderStuck = 30, "encoder or its side stuck";
        /// Master and slave have moved apart: line ruptured, slipped, or leaking.
        Disagreement = 31, "master and slave disagree";
        /// The output was at its limit for too long.
        Saturated = 32, "output at its limit for too long";
        /// Motor and amplifier have had more than they bear for long.
        MotorOverload = 33, "motor thermal limit";
        /// The volts that were read back are not those that were written.
        ReadBack = 34, "read-back differs from the output";
        /// The card reports motor power that nothing permits.
        MotorPowered = 35, "motor power stays on";
        /// A sensor reads the end of its input's range.
        SensorRailed = 36, "sensor at the end of its range";
        /// A sensor's reading does not change by one bit.
        SensorStuck = 37, "sensor reading does not change";
        /// No logger runs.
        LoggerLost = 38, "logger lost";
        /// The card reports no motor power although it is permitted: it did not come, or was cut
        /// from outside.
        PowerMissing = 39, "motor power missing";
        /// The handle is beyond the range of motion that the rig file gives for the subject.
        RangeOfMotion = 40, "handle beyond the subject's range of motion";
    }

    /// What control does.
    Mode {
        /// 0 V.
        Passive = 0, "passive";
        /// Holds the position at which the mode began, or that of the setpoint.
        Hold = 1, "hold";
        /// Follows the setpoint's position, velocity, acceleration.
        Position = 2, "position";
        /// Moves with the hand (force control) and lets it feel the setpoint's force field.
        Impedance = 3, "impedance";
        /// Drives gently to the ends of the range, to find them: follows the setpoint within its
        /// own limit on volts.
        Initialise = 4, "initialise";
        /// Goes to the setpoint's position, the middle of the range, and rests there under power.
        Centre = 5, "centre";
        /// Moves with the hand, as [`Self::Impedance`], while the hand keeps a rhythm in the
        /// setpoint's force field.
        Rhythm = 6, "rhythm";
        /// Follows the setpoint through a movement that repeats, along a reference that is learnt
        /// from block to block.
        Learning = 7, "learning";
    }

    /// What timing the machine grants.
    Profile {
        /// `SCHED_FIFO` granted.
        Realtime = 0, "realtime";
        /// Unprivileged: longer lives of token and command, simulated card only.
        BestEffort = 1, "best-effort";
    }

    /// How bad an event is.
    Severity {
        /// As intended.
        Info = 0, "info";
        /// Works, but somebody should look.
        Warning = 1, "warning";
        /// Power was cut or data was lost.
        Error = 2, "error";
    }

    /// What happened.
    EventKind {
        /// A process is ready.
        ProcessStarted = 0, "process started";
        /// A process ends in good order.
        ProcessEnding = 1, "process ending";
        /// The watchdog changed state: `a` from, `b` to, `c` the cause.
        StateChanged = 2, "state changed";
        /// A verb was refused: the text says why.
        VerbRefused = 3, "verb refused";
        /// A protocol begins.
        ProtocolStarted = 4, "protocol started";
        /// A segment begins: `a` its index.
        SegmentStarted = 5, "segment started";
        /// A protocol came to its end.
        ProtocolDone = 6, "protocol done";
        /// A protocol was stopped before its end.
        ProtocolStopped = 7, "protocol stopped";
        /// A protocol goes on after a restart of the experiment process: `a` the segment.
        ProtocolResumed = 8, "protocol resumed";
        /// Data was lost: `a` how many messages.
        DataLost = 9, "data lost";
        /// A recording begins.
        RecordingStarted = 10, "recording started";
        /// A recording ends.
        RecordingStopped = 11, "recording stopped";
        /// Control took over from the measured position: `a` position, axis 0.
        ControlResumed = 12, "control resumed";
        /// The replayed record came to its end.
        ReplayDone = 13, "replay done";
        /// The card or its link reports a fault.
        CardFault = 14, "card fault";
        /// The ends of the range were found: `a` the lower, `b` the upper, `c` the axis.
        RangeFound = 15, "range found";
        /// A block of learning is done: `a` its number, `b` the error of its settled cycles, `c`
        /// the best so far.
        BlockLearnt = 16, "block learnt";
        /// Learning ended, with the best reference: `a` the last block, `b` the best block's error;
        /// the text says why.
        LearningEnded = 17, "learning ended";
        /// Control does not follow a setpoint: the text says why; `a` its sequence.
        SetpointRefused = 18, "setpoint refused";
        /// The beat of a rhythm: `a` where the hand should be (rad or m), `b` its number from 1.
        Beat = 19, "beat";
        /// An axis was homed: `a` its index, `b` and `c` the counts of its master and slave at
        /// position 0.
        AxisHomed = 20, "axis homed";
        /// An axis is unhomed: `a` its index; the text says why.
        HomingLost = 21, "homing lost";
        /// A pulse of the scanner ended a wait: `a` when it came, from the wait's beginning (s).
        ScannerStarted = 22, "scanner started";
        /// Volumes had no pulse: `a` the number of the first, `b` how many.
        VolumesMissed = 23, "volumes missed";
        /// A pulse belongs to no volume: `a` the number of the last volume.
        PulseSpurious = 24, "spurious pulse";
        /// The scanner was started anew: `a` the number of the first volume since.
        ScannerRestarted = 25, "scanner restarted";
        /// A protocol with a scan has ended: `a` volumes with a pulse, `b` without, `c` pulses that
        /// belong to none; the text says whether as many were expected.
        VolumesCounted = 26, "volumes counted";
        /// A session begins, and the subject's light turns green: `a` its number, `b` how many
        /// there are.
        SessionStarted = 27, "session started";
        /// A session is over, and the light turns red: `a` its number, `b` and `c` what the next
        /// one has to match; the text says how it ended.
        SessionOver = 28, "session over";
        /// A person's note: the text, which begins with the author where `rec tag` gave it.
        Note = 29, "note";
        /// A page of the console was opened: `a` its number; the text says which and from where.
        PageOpened = 30, "page opened";
        /// A page was closed, or its connection lost: `a` its number.
        PageClosed = 31, "page closed";
        /// A page took control of the console: `a` its number.
        ControlTaken = 32, "control taken";
        /// A page's clock against CLOCK_MONOTONIC: `a` its number, `b` how far it is ahead, `c` the
        /// round trip of the exchange that showed it (s).
        ClockMeasured = 33, "clock of a page";
        /// From the instant that a bar shows to the frame of a page that shows it: `a` the page's
        /// number, `b` the median, `c` the longest of the latest frames (s).
        FrameDelay = 34, "delay of a page's frames";
        /// The digital output gave a pulse for the beginning of a session, or, as the text then
        /// says, gave none: `a` the session's number, `b` how long after its beginning (s), `c` the
        /// output.
        SyncPulse = 35, "sync pulse";
        /// A segment begins with an instruction of the protocol for the subject: the text.
        Instruction = 36, "instruction";
        /// A segment begins with a sound: `a` the Sound, also in the text.
        Sound = 37, "sound";
        /// What the subject's page shows as instruction from now on: the text.
        InstructionShown = 38, "instruction shown";
        /// A page made a sound: `a` its number, `b` how long after the event that the text names
        /// (s).
        SoundPlayed = 39, "sound played";
        /// The maxima of the muscles' activity that a protocol has measured were saved under the
        /// name in the text, or, as it then says, not: `a` how many electrodes have one.
        MaximaSaved = 40, "maxima saved";
        /// The monitor knows what is usual on an axis: `a` the axis, `b` the standard deviation of
        /// the master's innovation, `c` of the slave's (rad).
        BaselineLearnt = 41, "baseline learnt";
        /// The machine departs from the model beside it: `a` the axis, `b` the size of the effect
        /// in the text (in its default size), `c` the share of the departure that it explains.
        ModelDeparted = 42, "model departed";
        /// The machine is again as it was: `a` the axis.
        ModelReturned = 43, "model returned";
        /// An axis is not monitored, for the reason in the text: `a` the axis.
        NotMonitored = 44, "not monitored";
        /// The simulated machine was changed while it moves: the text has its effects, `a` how
        /// many.
        EffectsChanged = 45, "effects changed";
        /// The clock of the day was set: `a` by how much (s).
        ClockStepped = 46, "clock stepped";
        /// A fault was put into the simulated card or machine: `a` the tick of the first scan with
        /// it, `b` the axis, `c` its size; the text has the fault.
        FaultBegun = 47, "fault begun";
        /// A fault of the simulated card or machine is over: `a` the tick of the first scan without
        /// it, `b` the axis; the text has the fault.
        FaultEnded = 48, "fault ended";
        /// The rig was armed with `arm --unchecked`: the text says what spoke against it, or that
        /// nothing did.
        ArmedUnchecked = 49, "armed unchecked";
        /// From now on a program of others runs in place of a process: the text has the process and
        /// the command, as far as it fits.
        ProcessReplaced = 50, "process replaced";
        /// From now on a process that was replaced runs farreach's own program: the text has the
        /// process.
        ProcessRestored = 51, "process restored";
    }

    /// What the monitor knows of an axis.
    MonitorState {
        /// Nothing: there is no such axis, or its model cannot be simulated.
        Blind = 0, "not monitored";
        /// It learns what is usual, while the machine moves.
        Learning = 1, "learning";
        /// The machine is as the model.
        Steady = 2, "steady";
        /// More than usual, not yet for long enough to be sure.
        Suspicious = 3, "suspicious";
        /// The machine has departed from the model.
        Departed = 4, "departed";
    }

    /// Where an effect acts.
    ModelSite {
        /// Nowhere: there is none.
        None = 0, "none";
        /// Amplifier and motor.
        Drive = 1, "drive";
        /// Master side.
        Master = 2, "master";
        /// The transmission.
        Line = 3, "line";
        /// Slave side and handle.
        Slave = 4, "slave";
        /// The instruments.
        Sensor = 5, "sensor";
    }

    /// How a session ended.
    SessionOutcome {
        /// It ran to its end.
        Whole = 0, "whole";
        /// The protocol ended in it.
        Stopped = 1, "stopped";
        /// It is begun again, after a pause.
        Interrupted = 2, "interrupted";
    }

    /// A sound for the subject.
    Sound {
        /// A high tone.
        High = 0, "high";
        /// A tone between the two.
        Middle = 1, "middle";
        /// A low tone.
        Low = 2, "low";
    }

    /// The subject's light.
    Light {
        /// No session runs.
        Red = 0, "red";
        /// A session runs.
        Green = 1, "green";
    }

    /// What happened on the scanner's trigger line.
    LineEvent {
        /// A volume began; on a gate, the first one.
        Pulse = 0, "pulse";
        /// The gate closed.
        GateEnd = 1, "gate closed";
        /// A level was too short.
        Glitch = 2, "glitch";
    }

    /// Where a volume's time comes from.
    VolumeSource {
        /// A pulse of the scanner.
        Pulse = 0, "pulse";
        /// It had none: its time lies between those of its neighbours.
        Interpolated = 1, "interpolated";
        /// The emulated scanner.
        Emulated = 2, "emulated";
        /// The gate is open: the repetition time has passed since the last one.
        Gate = 3, "gate";
        /// The key 5, as the scanner's trigger box types it.
        Key = 4, "key";
    }
}

impl Mode {
    /// Whether the setpoint moves: position, velocity and acceleration are followed, not the
    /// position alone.
    pub const fn moves(self) -> bool {
        matches!(self, Self::Position | Self::Initialise | Self::Learning)
    }

    /// Whether the handle is force-controlled: it follows the hand, which feels the setpoint's
    /// force field.
    pub const fn is_force_controlled(self) -> bool {
        matches!(self, Self::Impedance | Self::Rhythm)
    }
}

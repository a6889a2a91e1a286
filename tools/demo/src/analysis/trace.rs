//! What of a recording is looked at: axis 0, in the order of the file.

use std::path::Path;

use ipc_types::{
    CARD_SCAN, COMMAND, Event, LoopTiming, Message, Process, Profile, SAMPLE, TOKEN, TypedTopic, event_topic,
    timing_topic,
};
use recording::mcap_read::{Check, ReadError, Recording};
use recording::mcap_write::key;

/// The recording cannot be used at all.
#[derive(Debug, thiserror::Error)]
pub enum TraceError {
    /// It cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// It holds nothing to report.
    #[error("{file}: expected samples of acquisition, found none; was the recording started after the rig went down?")]
    Empty {
        /// The file.
        file: String,
    },
}

/// One sample.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SampleRow {
    /// Incarnation of acquisition.
    pub incarnation: u64,
    /// Its count.
    pub sequence: u64,
    /// When it was published [ns, CLOCK_MONOTONIC].
    pub time_ns: u64,
    /// Tick of the grid.
    pub tick: u64,
    /// When the card took the scan [ns, CLOCK_MONOTONIC].
    pub scan_ns: u64,
    /// Master [rad or m].
    pub master: f64,
    /// Slave [rad or m]; not finite where there is no encoder.
    pub slave: f64,
    /// Torque of the hand [N·m or N]; not finite where there is no channel.
    pub torque: f64,
    /// Volts at the motor.
    pub motor_v: f64,
    /// `GateState`.
    pub gate_state: u8,
    /// `GateCause`.
    pub gate_cause: u8,
    /// Cycles that acquisition skipped.
    pub cycles_missed: u64,
    /// `Profile`.
    pub profile: u8,
}

/// One command.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CommandRow {
    /// Incarnation of control.
    pub incarnation: u64,
    /// Its count.
    pub sequence: u64,
    /// When it was published [ns, CLOCK_MONOTONIC].
    pub time_ns: u64,
    /// Tick of the sample that it answers.
    pub sample_tick: u64,
    /// Scan time of that sample [ns, CLOCK_MONOTONIC].
    pub sample_ns: u64,
    /// Volts asked for.
    pub volts: f64,
    /// Reference position [rad or m].
    pub reference: f64,
    /// Cycles that control skipped.
    pub cycles_missed: u64,
    /// `Profile`.
    pub profile: u8,
}

/// One scan of the card: the witness of what the motor got.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ScanRow {
    /// When the card took it [ns, CLOCK_MONOTONIC].
    pub scan_ns: u64,
    /// Volts that the DAC holds.
    pub dac_v: f64,
    /// Volts that reach the motor.
    pub motor_v: f64,
    /// `Profile` of the simulator.
    pub profile: u8,
}

/// One token, with what the watchdog thinks.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TokenRow {
    /// Incarnation of the watchdog.
    pub incarnation: u64,
    /// When it was published [ns, CLOCK_MONOTONIC].
    pub time_ns: u64,
    /// Enable epoch.
    pub epoch: u64,
    /// Whether the motor may be powered.
    pub enabled: bool,
    /// `WatchdogState`.
    pub state: u8,
    /// `TripCause`.
    pub cause: u8,
    /// Cycles that the watchdog skipped.
    pub cycles_missed: u64,
    /// `Profile`.
    pub profile: u8,
}

/// A recording, as far as it is looked at.
#[derive(Debug)]
pub struct Trace {
    /// Acquisition.
    pub samples: Vec<SampleRow>,
    /// Control.
    pub commands: Vec<CommandRow>,
    /// The card.
    pub scans: Vec<ScanRow>,
    /// The watchdog.
    pub tokens: Vec<TokenRow>,
    /// How punctual every loop was, once a second.
    pub timings: Vec<LoopTiming>,
    /// What happened.
    pub events: Vec<Event>,
    /// Counts, gaps, damage.
    pub check: Check,
    /// The logger's counters at the end, by topic: gaps, dropped, refused.
    pub counted: Vec<(String, u64)>,
    /// Size of the file [bytes].
    pub bytes: u64,
    /// Git revision of the build that recorded, where the recording says so.
    pub revision: Option<String>,
}

impl Trace {
    /// Reads a recording; damaged chunks are skipped and stand in [`Trace::check`].
    ///
    /// # Errors
    /// [`TraceError`] where there is nothing to work on.
    pub fn read(path: &Path) -> Result<Self, TraceError> {
        let recording = Recording::open(path)?;
        let samples: Vec<SampleRow> = rows(&recording, SAMPLE, |s| {
            let present = |bits: u8, value: f64| if bits & 1 == 1 { value } else { f64::NAN };
            SampleRow {
                incarnation: s.incarnation,
                sequence: s.sequence,
                time_ns: s.time_ns,
                tick: s.tick,
                scan_ns: s.scan_time_ns,
                master: present(s.master_present, s.master_position[0]),
                slave: present(s.slave_present, s.slave_position[0]),
                torque: present(s.torque_present, s.slave_torque[0]),
                motor_v: s.motor_v[0],
                gate_state: s.gate_state,
                gate_cause: s.gate_cause,
                cycles_missed: s.cycles_missed,
                profile: s.profile,
            }
        })?;
        if samples.is_empty() {
            return Err(TraceError::Empty { file: path.display().to_string() });
        }
        let commands = rows(&recording, COMMAND, |c| CommandRow {
            incarnation: c.incarnation,
            sequence: c.sequence,
            time_ns: c.time_ns,
            sample_tick: c.sample_tick,
            sample_ns: c.sample_time_ns,
            volts: c.volts[0],
            reference: c.reference_position[0],
            cycles_missed: c.cycles_missed,
            profile: c.profile,
        })?;
        let scans = rows(&recording, CARD_SCAN, |s| ScanRow {
            scan_ns: s.scan_time_ns,
            dac_v: s.dac_v[0],
            motor_v: s.motor_v[0],
            profile: s.profile,
        })?;
        let tokens = rows(&recording, TOKEN, |t| TokenRow {
            incarnation: t.incarnation,
            time_ns: t.time_ns,
            epoch: t.epoch,
            enabled: t.enabled == 1,
            state: t.state,
            cause: t.cause,
            cycles_missed: t.cycles_missed,
            profile: t.profile,
        })?;
        let mut timings = Vec::new();
        let mut events = Vec::new();
        for &process in Process::ALL {
            if let Some(topic) = timing_topic(process) {
                timings.extend(rows(&recording, topic, |timing| timing)?);
            }
            if let Some(topic) = event_topic(process) {
                events.extend(rows(&recording, topic, |event| event)?);
            }
        }
        events.sort_by_key(|event| event.time_ns);
        let counted = recording.end_record().map(|end| {
            let of = |name: &str, counter: &str| {
                end.get(&format!("{name}.{counter}")).and_then(|text| text.parse::<u64>().ok()).unwrap_or(0)
            };
            let topics = ipc_types::TOPICS.iter();
            topics
                .map(|t| (t.name.to_owned(), of(t.name, "gaps") + of(t.name, "dropped") + of(t.name, "refused")))
                .collect()
        });
        Ok(Self {
            samples,
            commands,
            scans,
            tokens,
            timings,
            events,
            check: recording.check()?,
            counted: counted.unwrap_or_default(),
            bytes: recording.bytes(),
            revision: recording.metadata(key::REVISION).map(str::to_owned),
        })
    }

    /// First instant of the run: the first scan [ns, CLOCK_MONOTONIC].
    pub fn begin_ns(&self) -> u64 {
        self.samples.iter().map(|s| s.scan_ns).min().unwrap_or(0)
    }

    /// Seconds since the first scan; negative before it.
    pub fn seconds(&self, time_ns: u64) -> f64 {
        (time_ns as i128 - i128::from(self.begin_ns())) as f64 * 1e-9
    }

    /// The samples by tick, each tick once: a successor may publish a scan again that its predecessor published last.
    pub fn by_tick(&self) -> Vec<SampleRow> {
        by_tick(&self.samples)
    }
}

/// See [`Trace::by_tick`].
pub(crate) fn by_tick(samples: &[SampleRow]) -> Vec<SampleRow> {
    let mut rows = samples.to_vec();
    rows.sort_by_key(|row| row.tick);
    rows.dedup_by_key(|row| row.tick);
    rows
}

fn rows<T: Message, R>(
    recording: &Recording,
    topic: TypedTopic<T>,
    row: impl Fn(T) -> R,
) -> Result<Vec<R>, TraceError> {
    let messages = match recording.messages::<T>(topic.topic.name) {
        Ok(messages) => messages,
        Err(ReadError::NoTopic { .. }) => return Ok(Vec::new()),
        Err(error) => return Err(error.into()),
    };
    let mut rows = Vec::new();
    for message in messages {
        match message {
            Ok(recorded) => rows.push(row(recorded.message)),
            // Both stand in the check; what follows is read.
            Err(ReadError::Damaged { .. } | ReadError::Schema { .. }) => {}
            Err(error) => return Err(error.into()),
        }
    }
    Ok(rows)
}

/// In the JSON: `realtime` only when every message says so.
pub(crate) fn is_realtime(code: u8) -> bool {
    Profile::from_code(code) == Some(Profile::Realtime)
}

//! What of a recording is looked at: axis 0, in the order of the file.

use std::collections::BTreeMap;
use std::path::Path;

use ipc_types::{
    CARD_SCAN, COMMAND, CardScan, EnableToken, Event, LoopTiming, MotorCommand, Process, Profile,
    SAMPLE, Sample, TOKEN, TOPICS, event_topic, timing_topic,
};
use recording::mcap_read::{Check, ReadError, Recording, Selection};
use recording::mcap_write::key;
use recording::schema::{Conversion, Layout};

/// The recording cannot be used at all.
#[derive(Debug, thiserror::Error)]
pub enum TraceError {
    /// It cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// It holds nothing to report.
    #[error(
        "{file}: expected samples of acquisition, found none; was the recording started after the \
            rig went down?"
    )]
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
    /// When it was published (ns, CLOCK_MONOTONIC).
    pub time_ns: u64,
    /// Tick of the grid.
    pub tick: u64,
    /// When the card took the scan (ns, CLOCK_MONOTONIC).
    pub scan_ns: u64,
    /// Master (rad or m).
    pub master: f64,
    /// Slave (rad or m); not finite where there is no encoder.
    pub slave: f64,
    /// Torque of the hand (N·m or N); not finite where there is no channel.
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
    /// When it was published (ns, CLOCK_MONOTONIC).
    pub time_ns: u64,
    /// Tick of the sample that it answers.
    pub sample_tick: u64,
    /// Scan time of that sample (ns, CLOCK_MONOTONIC).
    pub sample_ns: u64,
    /// Volts asked for.
    pub volts: f64,
    /// Reference position (rad or m).
    pub reference: f64,
    /// Cycles that control skipped.
    pub cycles_missed: u64,
    /// `Profile`.
    pub profile: u8,
}

/// One scan of the card: the witness of what the motor got.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ScanRow {
    /// When the card took it (ns, CLOCK_MONOTONIC).
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
    /// When it was published (ns, CLOCK_MONOTONIC).
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
#[derive(Debug, Default)]
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
    /// Size of the file (bytes).
    pub bytes: u64,
    /// First instant of the run: the first scan (ns, CLOCK_MONOTONIC).
    pub begin_ns: u64,
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
        let mut trace = Self::default();
        let mut kinds: BTreeMap<u16, (Kind, &Layout, Conversion)> = BTreeMap::new();
        for (&id, channel) in recording.channels() {
            if let (Some(kind), Ok(layout)) = (Kind::of(&channel.topic), &channel.layout) {
                kinds.insert(id, (kind, layout, kind.conversion(layout)));
            }
        }
        let channels = Some(kinds.keys().copied().collect());
        for message in recording.raw(Selection { channels, ..Selection::default() }) {
            let message = match message {
                Ok(message) => message,
                // stands in the check; what follows is read
                Err(ReadError::Damaged { .. }) => continue,
                Err(error) => return Err(error.into()),
            };
            let Some((kind, layout, conversion)) = kinds.get(&message.channel_id()) else {
                continue;
            };
            let Ok(body) = layout.body(message.data()) else { continue };
            match kind {
                Kind::Sample => trace.samples.extend(conversion.apply(body).map(sample_row)),
                Kind::Command => trace.commands.extend(conversion.apply(body).map(command_row)),
                Kind::Scan => trace.scans.extend(conversion.apply(body).map(scan_row)),
                Kind::Token => trace.tokens.extend(conversion.apply(body).map(token_row)),
                Kind::Timing => trace.timings.extend(conversion.apply::<LoopTiming>(body)),
                Kind::Event => trace.events.extend(conversion.apply::<Event>(body)),
            }
        }
        if trace.samples.is_empty() {
            return Err(TraceError::Empty { file: path.display().to_string() });
        }
        trace.begin_ns = trace.samples.iter().map(|sample| sample.scan_ns).min().unwrap_or(0);
        trace.events.sort_by_key(|event| event.time_ns);
        if let Some(end) = recording.end_record() {
            let of = |name: &str, counter: &str| {
                end.get(&format!("{name}.{counter}"))
                    .and_then(|text| text.parse::<u64>().ok())
                    .unwrap_or(0)
            };
            let lost = |name| of(name, "gaps") + of(name, "dropped") + of(name, "refused");
            trace.counted =
                TOPICS.iter().map(|topic| (topic.name.to_owned(), lost(topic.name))).collect();
        }
        trace.check = recording.check()?;
        trace.bytes = recording.bytes();
        trace.revision = recording.metadata(key::REVISION).map(str::to_owned);
        Ok(trace)
    }

    /// Seconds since the first scan; negative before it.
    pub fn seconds(&self, time_ns: u64) -> f64 {
        (time_ns as i128 - i128::from(self.begin_ns)) as f64 * 1e-9
    }

    /// The samples by tick, each tick once: a successor may publish a scan again that its
    /// predecessor published last.
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

/// What a topic is looked at for.
#[derive(Clone, Copy, Debug)]
enum Kind {
    Sample,
    Command,
    Scan,
    Token,
    Timing,
    Event,
}

impl Kind {
    fn of(topic: &str) -> Option<Self> {
        let per_process = |name: fn(Process) -> Option<&'static str>| {
            Process::ALL.iter().any(|process| name(*process) == Some(topic))
        };
        match topic {
            _ if topic == SAMPLE.topic.name => Some(Self::Sample),
            _ if topic == COMMAND.topic.name => Some(Self::Command),
            _ if topic == CARD_SCAN.topic.name => Some(Self::Scan),
            _ if topic == TOKEN.topic.name => Some(Self::Token),
            _ if per_process(|process| timing_topic(process).map(|t| t.topic.name)) => {
                Some(Self::Timing)
            }
            _ if per_process(|process| event_topic(process).map(|t| t.topic.name)) => {
                Some(Self::Event)
            }
            _ => None,
        }
    }

    /// Recordings of older builds may have other layouts.
    fn conversion(self, layout: &Layout) -> Conversion {
        match self {
            Self::Sample => layout.conversion::<Sample>(),
            Self::Command => layout.conversion::<MotorCommand>(),
            Self::Scan => layout.conversion::<CardScan>(),
            Self::Token => layout.conversion::<EnableToken>(),
            Self::Timing => layout.conversion::<LoopTiming>(),
            Self::Event => layout.conversion::<Event>(),
        }
    }
}

fn sample_row(s: Sample) -> SampleRow {
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
}

fn command_row(c: MotorCommand) -> CommandRow {
    CommandRow {
        incarnation: c.incarnation,
        sequence: c.sequence,
        time_ns: c.time_ns,
        sample_tick: c.sample_tick,
        sample_ns: c.sample_time_ns,
        volts: c.volts[0],
        reference: c.reference_position[0],
        cycles_missed: c.cycles_missed,
        profile: c.profile,
    }
}

fn scan_row(s: CardScan) -> ScanRow {
    ScanRow {
        scan_ns: s.scan_time_ns,
        dac_v: s.dac_v[0],
        motor_v: s.motor_v[0],
        profile: s.profile,
    }
}

fn token_row(t: EnableToken) -> TokenRow {
    TokenRow {
        incarnation: t.incarnation,
        time_ns: t.time_ns,
        epoch: t.epoch,
        enabled: t.enabled == 1,
        state: t.state,
        cause: t.cause,
        cycles_missed: t.cycles_missed,
        profile: t.profile,
    }
}

/// In the JSON: `realtime` only when every message says so.
pub(crate) fn is_realtime(code: u8) -> bool {
    Profile::from_code(code) == Some(Profile::Realtime)
}

//! What is to be played: the options, and the protocol that they name.

use std::path::{Path, PathBuf};

use ipc_types::{EmulatedScanner, ExperimentRequest, PulseSource};
use recording::mcap_read::Recording;
use recording::mcap_write::key;
use rig::protocol::{Protocol, with_overrides};
use runtime::clock::now_ns;

use crate::{Error, RigLink};

/// Key of the overrides in a run's metadata.
const OVERRIDES: &str = "protocol_overrides";

/// What to run.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct RunOptions {
    /// Protocol file, or the name of a protocol shipped with farreach
    #[arg(value_name = "FILE|NAME", required_unless_present_any = ["from", "continues"])]
    pub protocol: Option<PathBuf>,
    /// Repeats the protocol that was played last in a recording, with its values and its subject
    #[arg(long, value_name = "RECORDING", conflicts_with = "protocol")]
    pub from: Option<PathBuf>,
    /// Continues the protocol with sessions that was interrupted, by a trip, a stop or the death of
    /// the whole computer, from the beginning of the session in which it was
    #[arg(
        long = "continue",
        conflicts_with_all = ["protocol", "from", "overrides", "emulate_scanner", "scanner_key"]
    )]
    pub continues: bool,
    /// Overrides a value of the protocol before the protocol is checked (repeatable)
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub overrides: Vec<String>,
    /// Subject code, stored in the recording
    #[arg(long, value_name = "ID")]
    pub subject: Option<String>,
    /// Plays without a scanner: pulses with this repetition time (s) take the place of the trigger
    /// line, from 1 s after the wait for the scanner began. Faults may follow: jitter=S,
    /// missing=VOLUME, spurious=S (from the first pulse), seed=N, each with a comma before it
    #[arg(long, value_name = "TR[,FAULT]...")]
    pub emulate_scanner: Option<EmulatedScanner>,
    /// Takes each 5 typed at this terminal for a pulse of the scanner, in place of the trigger line
    #[arg(long, conflicts_with = "emulate_scanner")]
    pub scanner_key: bool,
    /// Writes a MATLAB file at the end of each session: NAME1.mat, NAME2.mat, …; the rig must be
    /// recording
    #[arg(long, value_name = "NAME")]
    pub mat: Option<PathBuf>,
}

impl RunOptions {
    /// Where the scanner's pulses come from.
    pub fn pulses(&self) -> PulseSource {
        match &self.emulate_scanner {
            Some(scanner) => PulseSource::Emulated(scanner.clone()),
            None if self.scanner_key => PulseSource::Key,
            None => PulseSource::Line,
        }
    }

    /// The same, with pulses from there.
    #[must_use]
    pub fn with_pulses(mut self, source: PulseSource) -> Self {
        (self.scanner_key, self.emulate_scanner) = match source {
            PulseSource::Line => (false, None),
            PulseSource::Key => (true, None),
            PulseSource::Emulated(scanner) => (false, Some(scanner)),
        };
        self
    }
}

/// A protocol that was chosen and read, with what its recording is to say of it.
pub struct ChosenProtocol {
    protocol: Protocol,
    /// Number of the client that runs it.
    client: u64,
    subject: Option<String>,
    pulses: PulseSource,
    /// Of a protocol that is continued, the sessions that were over.
    continues: Option<u32>,
    /// The segment in which it was interrupted.
    segment: u32,
    /// All overrides that made its text, in their order.
    overrides: Vec<String>,
    /// Identity of the text without the overrides of the options, where these changed it.
    original: Option<u64>,
}

impl ChosenProtocol {
    /// The protocol.
    pub const fn protocol(&self) -> &Protocol {
        &self.protocol
    }

    /// Number of the client that runs it.
    pub const fn client(&self) -> u64 {
        self.client
    }

    /// Name under which it is run: with its subject.
    pub(crate) fn name(&self) -> String {
        match &self.subject {
            Some(subject) => format!("{}{SUBJECT}{subject})", self.protocol.name),
            None => self.protocol.name.clone(),
        }
    }

    /// Of a protocol that is continued, the sessions that were over.
    pub const fn continues(&self) -> Option<u32> {
        self.continues
    }

    /// The segment with which it begins: the one in which it was interrupted, or the first.
    pub(crate) const fn segment(&self) -> u32 {
        self.segment
    }

    /// Code of the subject.
    pub fn subject(&self) -> Option<&str> {
        self.subject.as_deref()
    }

    /// Where the scanner's pulses come from.
    pub const fn pulses(&self) -> &PulseSource {
        &self.pulses
    }

    /// Reads the protocol that the options name.
    ///
    /// # Errors
    /// If the file or the recording cannot be read, or the protocol is invalid.
    pub fn new(options: &RunOptions) -> Result<Self, Error> {
        let asked = options.protocol.as_deref().unwrap_or(Path::new(""));
        let mut chosen = match &options.from {
            Some(path) => Self::recorded(path, &options.overrides)?,
            None => Self::of(rig::load_protocol(asked, &options.overrides)?),
        };
        // Without its overrides a protocol may be incomplete: then there is no identity to name.
        if !options.overrides.is_empty() && options.from.is_none() {
            chosen.original = rig::load_protocol(asked, &[]).ok().map(|text| text.identity());
        }
        chosen.overrides.extend(options.overrides.iter().cloned());
        chosen.subject = options.subject.clone().or(chosen.subject);
        chosen.pulses = options.pulses();
        Ok(chosen)
    }

    /// The protocol of a rig that was interrupted.
    ///
    /// # Errors
    /// Where none was, or it cannot be continued now, or the experiment process does not answer.
    pub fn interrupted(link: &RigLink, options: &RunOptions) -> Result<Self, Error> {
        let answer = link.experiment(&ExperimentRequest::Interrupted)?;
        let run = answer.interrupted.ok_or(Error::Experiment(answer.error))?;
        let protocol = Protocol::parse(&run.protocol, &run.name)?;
        let subject = subject_of(&run.name, &protocol.name);
        Ok(Self {
            subject: options.subject.clone().or(subject),
            pulses: run.pulses,
            continues: Some(run.sessions_over),
            segment: run.segment,
            ..Self::of(protocol)
        })
    }

    /// A protocol as it is, without a subject, its pulses from the scanner's line.
    pub fn of(protocol: Protocol) -> Self {
        Self {
            protocol,
            client: client_number(),
            subject: None,
            pulses: PulseSource::Line,
            continues: None,
            segment: 0,
            overrides: Vec::new(),
            original: None,
        }
    }

    /// The protocol that was played last in a recording, with further overrides.
    fn recorded(path: &Path, overrides: &[String]) -> Result<Self, Error> {
        let recording = Recording::open(path)?;
        let played = recording.runs().filter_map(|run| Some((run, run.get(key::PROTOCOL_FILE)?)));
        let Some((run, text)) = played.last() else {
            return Err(Error::NothingPlayed(path.to_owned()));
        };
        let name = run.get(key::PROTOCOL).map_or("the protocol", String::as_str);
        let name = format!("{} ({name})", path.display());
        let text = with_overrides(text, &name, overrides)?;
        Ok(Self {
            subject: run.get(key::SUBJECT).cloned(),
            overrides: run.get(OVERRIDES).cloned().into_iter().collect(),
            ..Self::of(Protocol::parse(&text, &name)?)
        })
    }

    /// What a recording is to say of it, so that it stands alone: the protocol's text with the
    /// overrides applied, the overrides, the identity of the text without them, the subject, and
    /// where the scanner's pulses come from, if not from its line.
    pub(crate) fn metadata(&self) -> Vec<(String, String)> {
        let Self { protocol, subject, pulses, continues, overrides, original, .. } = self;
        let all = (!overrides.is_empty()).then(|| overrides.join("\n"));
        let entries = [
            (key::PROTOCOL, Some(protocol.name.clone())),
            (key::PROTOCOL_FILE, Some(protocol.text().to_owned())),
            (OVERRIDES, all),
            ("protocol_identity", original.map(|identity| format!("{identity:016x}"))),
            (key::SUBJECT, subject.clone()),
            ("continued_after_session", continues.map(|over| over.to_string())),
            (key::SCANNER_PULSES, (*pulses != PulseSource::Line).then(|| pulses.to_string())),
        ];
        entries.into_iter().filter_map(|(key, value)| Some((key.to_owned(), value?))).collect()
    }
}

/// Between a protocol's name and its subject's, in the name under which it is run.
const SUBJECT: &str = " (subject ";

/// The subject in the name under which a protocol was run.
fn subject_of(name: &str, protocol: &str) -> Option<String> {
    let rest = name.strip_prefix(protocol)?.strip_prefix(SUBJECT)?;
    rest.strip_suffix(')').map(str::to_owned)
}

/// A number that no other client of the rig has: the process and the time.
pub fn client_number() -> u64 {
    u64::from(std::process::id()) << 40 ^ now_ns()
}

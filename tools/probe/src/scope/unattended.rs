//! Waits for the trigger without a screen, and writes the window.

use std::io::Write;

use anyhow::bail;
use ipc_types::TOPICS;
use recorder::{DATA_LOST, DONE};
use rig::RigFile;
use runtime::RigName;

use crate::attach;
use crate::scope::args::ScopeArgs;
use crate::scope::capture::{Capture, Settings};
use crate::scope::channel::Channel;
use crate::scope::describe::condition;
use crate::scope::numbers::time;
use crate::scope::sampler::Sampler;
use crate::scope::window_file::{Kept, Kind, Target, Window};
use crate::stream::{Progress, Source};

/// What is captured, and where it goes.
pub(crate) struct Unattended<'a> {
    pub(crate) args: &'a ScopeArgs,
    pub(crate) rig_name: &'a RigName,
    pub(crate) rig: Option<&'a RigFile>,
    pub(crate) channels: &'a [Channel],
    pub(crate) settings: Settings,
    pub(crate) target: Target<'a>,
}

impl Unattended<'_> {
    /// Captures one window, writes it and says what is in it; the exit code.
    ///
    /// # Errors
    /// If nothing triggers in time, or the file cannot be written.
    pub(crate) fn run(
        &self,
        source: &mut dyn Source,
        mut sampler: Sampler,
        out: &mut dyn Write,
    ) -> anyhow::Result<i32> {
        let live = self.args.file.is_none();
        // Of a recording, the messages are in the recording.
        let mut kept =
            (live && self.target.kind == Kind::Mcap).then(|| Kept::new(self.settings.window_ns));
        let topics: Vec<_> = source
            .streams()
            .iter()
            .map(|stream| TOPICS.iter().position(|topic| topic.name == stream.name))
            .collect();
        let trigger = self.trigger();
        let timeout_ns = self.args.timeout.map(attach::ns);
        let mut began_ns = None;
        let capture = loop {
            let progress = source.read(u64::MAX, &mut |message| {
                let time_ns = sampler.take(message);
                let topic = topics.get(message.stream).copied().flatten();
                if let (Some(kept), Some(topic)) = (&mut kept, topic) {
                    kept.keep(time_ns, topic, message.bytes);
                }
            })?;
            let known_ns = match progress {
                Progress::UpTo(known_ns) => known_ns,
                Progress::Ended => break sampler.capturer.finish(),
            };
            if let Some(capture) = sampler.capturer.advance(known_ns) {
                break Some(capture);
            }
            let waited_ns = known_ns.saturating_sub(*began_ns.get_or_insert(known_ns));
            if timeout_ns.is_some_and(|limit| waited_ns >= limit) && sampler.capturer.is_waiting() {
                bail!(
                    "nothing triggered within {}: {trigger}{}; nothing was written",
                    time(waited_ns as f64 * 1e-9),
                    too_early(sampler.capturer.early())
                );
            }
        };
        let early = too_early(sampler.capturer.early());
        let Some(capture) = capture else {
            let place = &sampler.place;
            bail!(
                "{place}: it ended, and nothing had triggered: {trigger}{early}; nothing was \
                 written"
            );
        };
        if !early.is_empty() {
            eprintln!("{}: {trigger}{early}", self.target.path.display());
        }
        self.write(&sampler.place, &capture, &trigger, kept)?;
        self.tell(&capture, &trigger, out)?;
        Ok(if capture.lost() > 0 { DATA_LOST } else { DONE })
    }

    fn trigger(&self) -> String {
        let channel = self.channels.iter().find(|channel| channel.place == self.settings.channel);
        channel.map_or_else(String::new, |channel| condition(channel, &self.settings.condition))
    }

    fn write(
        &self,
        place: &str,
        capture: &Capture,
        trigger: &str,
        kept: Option<Kept>,
    ) -> anyhow::Result<()> {
        let window =
            Window { place, capture, channels: self.channels, settings: &self.settings, trigger };
        match (self.target.kind, kept) {
            (Kind::Svg, _) => self.target.write(window.svg()?),
            (Kind::Csv, _) => self.target.write(window.csv()?),
            (Kind::Mcap, Some(kept)) => {
                self.target.write_messages(capture, kept, self.rig_name, self.rig)
            }
            (Kind::Mcap, None) => match &self.args.file {
                Some(file) => self.target.copy_messages(capture, file),
                None => bail!("{}: no messages were kept", self.target.path.display()),
            },
        }
    }

    fn tell(&self, capture: &Capture, trigger: &str, out: &mut dyn Write) -> anyhow::Result<()> {
        let path = self.target.path.display();
        let why = if capture.triggered { trigger } else { "without a trigger" };
        let rows: usize = capture.rows.iter().map(|rows| rows.len()).sum();
        let length = time((capture.end_ns - capture.begin_ns) as f64 * 1e-9);
        writeln!(out, "{path}: {why}; {length}, {rows} messages, {} lost", capture.lost())?;
        if capture.overwritten {
            eprintln!("{path}: the beginning of the window is missing: it is longer than is kept");
        }
        if !capture.whole {
            eprintln!("{path}: the recording ends within the window");
        }
        Ok(())
    }
}

/// How often something triggered too early, and what to do; nothing where it did not.
fn too_early(times: u64) -> String {
    let often = match times {
        0 => return String::new(),
        1 => "once".to_owned(),
        _ => format!("{times} times"),
    };
    format!(
        " ({often} too early: the part of the window before the trigger was not there yet; a lower \
         --pre-trigger needs less)"
    )
}

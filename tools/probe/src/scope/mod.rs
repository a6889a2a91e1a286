//! `scope`: channels over time, as on an oscilloscope.
//!
//! [`trigger`] and [`capture`] are state machines that take samples and the time, and return
//! windows; [`ring`] holds the newest samples; [`decimate`] reduces them to the columns of a
//! screen. [`view`] is what the keys change, [`screen`] draws it, and [`terminal`] is the loop.
//! [`unattended`] waits for the trigger without a screen, and [`window_file`] writes the window.

mod args;
mod capture;
pub mod channel;
mod decimate;
mod describe;
mod numbers;
mod ring;
mod sampler;
mod screen;
mod terminal;
mod trigger;
mod unattended;
mod view;
mod window_file;

use std::io::{IsTerminal, Write};

use anyhow::bail;
use recording::mcap_read::Recording;
use rig::RigFile;
use runtime::RigName;
use runtime::clock::MILLISECOND_NS;

pub(crate) use args::ScopeArgs;

use crate::scope::capture::Capturer;
use crate::scope::channel::Reader;
use crate::scope::sampler::Sampler;
use crate::scope::unattended::Unattended;
use crate::scope::view::View;
use crate::source;

/// Polling period; the subscribers' buffers hold at least 100 ms (ns).
const PERIOD_NS: u64 = 10 * MILLISECOND_NS;

pub(crate) fn scope(
    args: &ScopeArgs,
    rig_name: &RigName,
    out: &mut dyn Write,
) -> anyhow::Result<i32> {
    let target = args.out.as_deref().map(window_file::Target::new).transpose()?;
    if target.is_none() && !(std::io::stdout().is_terminal() && std::io::stdin().is_terminal()) {
        bail!(
            "the screen needs a terminal: write the window to a file by --out, such as --out \
             window.svg"
        );
    }
    let names = args.channels();
    let rig = rig_file(args, rig_name, &names)?;
    let wanted = channel::wanted(&names, rig.as_ref())?;
    let topics = channel::topics_of(&wanted);
    source::observe(args.file.as_deref(), rig_name, &topics, PERIOD_NS, |source| {
        let (channels, readers) = channel::bind(&wanted, source.streams())?;
        let settings = args.settings(&channels)?;
        let widths: Vec<_> = readers.iter().map(Reader::width).collect();
        let capturer = Capturer::new(settings, &widths, ring::ROWS);
        let place = match &args.file {
            Some(file) => file.display().to_string(),
            None => format!("rig {rig_name}"),
        };
        let sampler = Sampler::new(place, readers, capturer, source.since_ns());
        let Some(target) = target else {
            let recorded = args.file.is_some();
            terminal::show(source, sampler, View::new(channels, settings, recorded), recorded)?;
            return Ok(source.exit_code());
        };
        let unattended =
            Unattended { args, rig_name, rig: rig.as_ref(), channels: &channels, settings, target };
        unattended.run(source, sampler, out)
    })
}

/// The rig file of the recording or of the running rig; `None` where no channel needs its names.
fn rig_file(
    args: &ScopeArgs,
    rig_name: &RigName,
    names: &[String],
) -> anyhow::Result<Option<RigFile>> {
    let paths = !names.is_empty() && names.iter().all(|name| name.contains('.'));
    let found = match &args.file {
        Some(file) => recorder::rig_file(&Recording::open(file)?),
        None => operator::rig_of(rig_name).map_err(anyhow::Error::from),
    };
    match found {
        Ok(rig) => Ok(Some(rig)),
        // Paths tell it all; and a rig that is not up is told by what attaches to it.
        Err(_) if paths => Ok(None),
        Err(error) => Err(error),
    }
}

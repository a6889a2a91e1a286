//! A stream of scans from a card's analog inputs.

use std::os::fd::AsFd;

use rustix::io::{Errno, Result, read};

use crate::call::{self, number};
use crate::device::{Device, Subdevice};
use crate::error::ComediError;
use crate::scan_bytes::ScanBytes;
use crate::uapi::{BufConfig, BufInfo, Command, WAKE_AT_END_OF_SCAN, source};

/// How often a command may be corrected until the card accepts it.
const CORRECTIONS: u32 = 4;

/// What is to be streamed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StreamSettings {
    /// Channels of a scan, in order ([`crate::channel_spec`]).
    pub channels: Vec<u32>,
    /// Time from scan to scan (ns).
    pub period_ns: u32,
    /// Time from channel to channel within a scan (ns); 0 for all at once, or as fast as the card
    /// can.
    pub convert_ns: u32,
    /// Scans that the kernel buffers at least.
    pub buffered_scans: usize,
}

/// What a read of the stream came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fetched {
    /// All that the kernel had.
    All,
    /// As much as there was room for.
    Some,
    /// All, and the stream has stopped: the kernel's buffer overran, or the card reported an error.
    /// What was in the buffer is there; what came after it is lost, and nothing counts it.
    Stopped,
}

/// A stream that was checked against the card.
#[derive(Debug)]
pub struct Stream {
    subdevice: u32,
    command: Command,
    channels: Vec<u32>,
    scans: ScanBytes,
    buffer_bytes: u32,
    period_ns: u64,
    /// Whether the driver can be asked to hand over what its hardware still holds.
    polls: bool,
}

impl Stream {
    /// Asks the card whether it can do that. Changes nothing.
    ///
    /// # Errors
    /// [`ComediError::Differs`] with what it can do instead.
    pub fn check(
        device: &Device,
        inputs: &Subdevice,
        settings: &StreamSettings,
    ) -> std::result::Result<Self, ComediError> {
        let mut channels = settings.channels.clone();
        let differs = |key: &str, expected: String, found: String, advice| ComediError::Differs {
            device: device.path().to_owned(),
            key: key.to_owned(),
            expected,
            found,
            advice,
        };
        let count = channels.len();
        if count > inputs.longest_scan() {
            let expected = format!("at most {} channels in a scan", inputs.longest_scan());
            return Err(differs("channels", expected, count.to_string(), "take some out"));
        }
        let possible = possible_sources(device, inputs, &mut channels)?;
        if possible.scan_begin_source & source::TIMER == 0 {
            let expected = "inputs that a timer of the card scans".to_owned();
            let found = format!("subdevice {} without one", inputs.number);
            let advice = "another card, or another subdevice, is needed";
            return Err(differs("comedi.input", expected, found, advice));
        }
        let at_once = settings.convert_ns == 0 && possible.convert_source & source::NOW != 0;
        let mut command = Command {
            subdevice: inputs.number,
            flags: WAKE_AT_END_OF_SCAN,
            start_source: source::NOW,
            scan_begin_source: source::TIMER,
            scan_begin_argument: settings.period_ns,
            convert_source: if at_once { source::NOW } else { source::TIMER },
            convert_argument: settings.convert_ns,
            scan_end_source: source::COUNT,
            scan_end_argument: count as u32,
            stop_source: source::NONE,
            ..Command::default()
        };
        let stage = corrected(device, &mut command, &mut channels)?;
        if stage != 0 {
            let expected = format!("{count} channels that the card scans together");
            let found = format!("a card that refuses them at stage {stage} of its test");
            let advice = "fewer channels, other ranges, or another comedi.reference may do";
            return Err(differs("channels", expected, found, advice));
        }
        if command.scan_begin_argument != settings.period_ns {
            let (wanted, nearest) = (settings.period_ns, command.scan_begin_argument);
            let expected = format!("a rate that the card keeps exactly ({wanted} ns)");
            let found = format!("{nearest} ns, the nearest that it can do with {count} channels");
            let advice = "take another rate, fewer channels, or a shorter comedi.convert_us";
            return Err(differs("rates.acquisition_hz", expected, found, advice));
        }
        let sample = inputs.sample_bytes();
        let bytes = settings.buffered_scans * count * sample;
        Ok(Self {
            subdevice: inputs.number,
            command,
            scans: ScanBytes::new(count, sample, settings.buffered_scans),
            channels,
            buffer_bytes: u32::try_from(bytes).unwrap_or(u32::MAX),
            period_ns: u64::from(settings.period_ns),
            polls: true,
        })
    }

    /// Time from scan to scan (ns).
    pub const fn period_ns(&self) -> u64 {
        self.period_ns
    }

    /// Takes the subdevice for this open file, and its buffer of the size that was asked for.
    ///
    /// # Errors
    /// When another process has it.
    pub fn reserve(&self, device: &Device) -> std::result::Result<(), ComediError> {
        device.lock(self.subdevice).map_err(device.refused("locking its inputs"))?;
        if device.read_subdevice() != Some(self.subdevice) {
            call::of_subdevice(device.as_fd(), number::SETRSUBD, self.subdevice)
                .map_err(device.refused("choosing its inputs"))?;
        }
        let mut config = BufConfig {
            subdevice: self.subdevice,
            size: self.buffer_bytes,
            ..BufConfig::default()
        };
        call::buffer_config(device.as_fd(), &mut config)
            .map_err(device.refused("setting the size of its buffer"))
    }

    /// Starts the stream, or starts it again.
    ///
    /// # Errors
    /// The kernel's.
    pub fn start(&mut self, device: &Device) -> Result<()> {
        self.scans.clear();
        let mut command = self.command;
        call::command(device.as_fd(), number::CMD, &mut command, &mut self.channels).map(drop)
    }

    /// Ends the stream. What was read stays.
    ///
    /// # Errors
    /// The kernel's.
    pub fn stop(&self, device: &Device) -> Result<()> {
        call::of_subdevice(device.as_fd(), number::CANCEL, self.subdevice).map(drop)
    }

    /// Reads what the kernel has. Waits for nothing.
    ///
    /// # Errors
    /// The kernel's: the card was unplugged.
    pub fn fetch(&mut self, device: &Device) -> Result<Fetched> {
        self.fetch_by(device, usize::MAX)
    }

    /// As [`Stream::fetch`], in reads of so many bytes at most.
    ///
    /// # Errors
    /// As [`Stream::fetch`].
    pub fn fetch_by(&mut self, device: &Device, most: usize) -> Result<Fetched> {
        if self.polls {
            let polled = call::of_subdevice(device.as_fd(), number::POLL, self.subdevice);
            // Also refused once the stream has stopped, which the read tells.
            self.polls = polled != Err(Errno::INVAL);
        }
        loop {
            let space = self.scans.space();
            let end = space.len().min(most);
            if end == 0 {
                return Ok(Fetched::Some);
            }
            match read(device.as_fd(), &mut space[..end]) {
                // Only a stream that has ended gives nothing, or does not belong to this file.
                Ok(0) | Err(Errno::PIPE | Errno::INVAL) => return Ok(Fetched::Stopped),
                Ok(bytes) => self.scans.filled(bytes),
                Err(Errno::AGAIN) => return Ok(Fetched::All),
                Err(Errno::INTR) => {}
                Err(error) => return Err(error),
            }
        }
    }

    /// Number of scans that were read and not taken yet.
    pub fn scans(&self) -> usize {
        self.scans.scans()
    }

    /// The oldest scan that was read: its codes, in the order of the channels.
    pub fn next_scan(&mut self) -> Option<impl Iterator<Item = u32>> {
        self.scans.next_scan()
    }

    /// Number of whole scans that wait in the kernel's buffer.
    ///
    /// # Errors
    /// The kernel's.
    pub fn waiting(&self, device: &Device) -> Result<usize> {
        let mut info = BufInfo { subdevice: self.subdevice, ..BufInfo::default() };
        call::buffer_info(device.as_fd(), &mut info)?;
        let bytes = info.write_count.wrapping_sub(info.read_count) as usize;
        Ok(bytes / self.scans.scan_bytes())
    }
}

const ASKING: &str = "asking what its inputs can stream";

/// The sources of events that the card has: the first stage of its test leaves these of all.
fn possible_sources(
    device: &Device,
    inputs: &Subdevice,
    channels: &mut [u32],
) -> std::result::Result<Command, ComediError> {
    let any = source::ANY;
    let mut possible = Command {
        subdevice: inputs.number,
        start_source: any,
        scan_begin_source: any,
        convert_source: any,
        scan_end_source: any,
        stop_source: any,
        ..Command::default()
    };
    call::command(device.as_fd(), number::CMDTEST, &mut possible, channels)
        .map_err(device.refused(ASKING))?;
    Ok(possible)
}

/// Has the card correct a command; returns the stage at which it still fails, or 0.
fn corrected(
    device: &Device,
    command: &mut Command,
    channels: &mut [u32],
) -> std::result::Result<i32, ComediError> {
    let mut stage = 0;
    for _ in 0..CORRECTIONS {
        stage = call::command(device.as_fd(), number::CMDTEST, command, channels)
            .map_err(device.refused(ASKING))?;
        if stage == 0 {
            break;
        }
    }
    Ok(stage)
}

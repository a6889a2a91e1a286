//! A device: what it has, and instructions to it.

use std::fmt::{self, Debug};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

use rustix::fs::{Mode, OFlags, open};
use rustix::io::{Errno, Result};

use crate::call::{self, PerChannel, number};
use crate::error::ComediError;
use crate::range::Range;
use crate::uapi::{self, DevConfig, Insn, SubdInfo, flag};

/// What a subdevice is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Analog inputs.
    AnalogInput,
    /// Analog outputs.
    AnalogOutput,
    /// Digital inputs.
    DigitalInput,
    /// Digital outputs.
    DigitalOutput,
    /// Digital lines whose direction is set.
    DigitalLines,
    /// Counters.
    Counter,
    /// Anything else.
    Other,
}

impl Kind {
    const fn of(code: u32) -> Self {
        match code {
            1 => Self::AnalogInput,
            2 => Self::AnalogOutput,
            3 => Self::DigitalInput,
            4 => Self::DigitalOutput,
            5 => Self::DigitalLines,
            6 => Self::Counter,
            _ => Self::Other,
        }
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::AnalogInput => "analog inputs",
            Self::AnalogOutput => "analog outputs",
            Self::DigitalInput => "digital inputs",
            Self::DigitalOutput => "digital outputs",
            Self::DigitalLines => "digital inputs and outputs",
            Self::Counter => "counters",
            Self::Other => "something else",
        })
    }
}

/// A part of a device: channels of one kind.
#[derive(Clone, Copy, Debug)]
pub struct Subdevice {
    /// Its number.
    pub number: u32,
    /// What it is.
    pub kind: Kind,
    /// Number of its channels.
    pub channels: u32,
    info: SubdInfo,
}

impl Subdevice {
    /// Whether its samples can be streamed into the computer.
    pub const fn streams_input(&self) -> bool {
        self.info.flags & flag::COMMAND_READ != 0
    }

    /// Most channels of a scan.
    pub const fn longest_scan(&self) -> usize {
        self.info.chanlist_length as usize
    }

    /// Bytes of a sample in a stream.
    pub const fn sample_bytes(&self) -> usize {
        if self.info.flags & flag::LONG_SAMPLES != 0 { 4 } else { 2 }
    }

    /// Whether its ranges are nominal until a program has measured the card's errors.
    pub const fn is_calibrated_by_software(&self) -> bool {
        self.info.flags & flag::SOFT_CALIBRATED != 0
    }
}

/// An open device (`/dev/comediN`).
pub struct Device {
    file: OwnedFd,
    path: String,
    driver: String,
    read_subdevice: Option<u32>,
    subdevices: Vec<Subdevice>,
}

impl Debug for Device {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({})", self.path, self.driver)
    }
}

impl AsFd for Device {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.file.as_fd()
    }
}

/// A name of the kernel's, which ends at a zero.
fn text(bytes: &[u8]) -> String {
    let length = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..length]).into_owned()
}

fn open_node(path: &str) -> std::result::Result<OwnedFd, ComediError> {
    let flags = OFlags::RDWR | OFlags::NONBLOCK | OFlags::CLOEXEC;
    open(path, flags, Mode::empty())
        .map_err(|source| ComediError::Open { device: path.to_owned(), source })
}

impl Device {
    /// Opens a device and asks what it has.
    ///
    /// # Errors
    /// When there is none, it may not be opened, or no driver is attached to it.
    pub fn open(path: &str) -> std::result::Result<Self, ComediError> {
        let file = open_node(path)?;
        let refused =
            |doing| move |source| ComediError::Refused { device: path.to_owned(), doing, source };
        let info = call::device_info(file.as_fd()).map_err(refused("asking for its driver"))?;
        let infos =
            call::subdevice_infos(file.as_fd()).map_err(refused("asking for its subdevices"))?;
        let subdevices = (0u32..)
            .zip(infos)
            .map(|(number, info)| Subdevice {
                number,
                kind: Kind::of(info.kind),
                channels: info.channels,
                info,
            })
            .collect();
        Ok(Self {
            file,
            path: path.to_owned(),
            driver: text(&info.driver),
            read_subdevice: u32::try_from(info.read_subdevice).ok(),
            subdevices,
        })
    }

    /// Attaches a driver by name to a legacy device node, as root; another one that is attached is
    /// detached first. For cards without a bus that names them (`comedi_parport`).
    ///
    /// # Errors
    /// When the node cannot be opened, or the driver refuses.
    pub fn attach(
        path: &str,
        driver: &str,
        options: &[i32],
    ) -> std::result::Result<(), ComediError> {
        let file = open_node(path)?;
        let refused =
            |doing, source| ComediError::Refused { device: path.to_owned(), doing, source };
        call::configure(file.as_fd(), None)
            .map_err(|source| refused("detaching its driver", source))?;
        let mut config = DevConfig { board: [0; 20], options: [0; 32] };
        // The last byte stays zero.
        for (to, from) in config.board[..19].iter_mut().zip(driver.as_bytes()) {
            *to = *from;
        }
        for (to, from) in config.options.iter_mut().zip(options) {
            *to = *from;
        }
        call::configure(file.as_fd(), Some(&mut config))
            .map_err(|source| refused("attaching a driver", source))
    }

    /// The path by which it was opened.
    pub fn path(&self) -> &str {
        &self.path
    }

    /// Name of its driver.
    pub fn driver(&self) -> &str {
        &self.driver
    }

    /// Its subdevices, in the order of their numbers.
    pub fn subdevices(&self) -> &[Subdevice] {
        &self.subdevices
    }

    /// The subdevice that [`Device::as_fd`] reads from, unless told otherwise.
    pub(crate) fn read_subdevice(&self) -> Option<u32> {
        self.read_subdevice
    }

    /// A subdevice of one of these kinds that has a channel; `key` is the key of the rig file that
    /// asks for it.
    ///
    /// # Errors
    /// [`ComediError::Differs`].
    pub fn expect(
        &self,
        key: &str,
        subdevice: u32,
        channel: u32,
        kinds: &[Kind],
    ) -> std::result::Result<Subdevice, ComediError> {
        let differs = |key: String, expected: String, found: String| ComediError::Differs {
            device: self.path.clone(),
            key,
            expected,
            found,
            advice: "`/proc/comedi` and the driver's manual tell which subdevice is what",
        };
        let wanted: Vec<String> = kinds.iter().map(ToString::to_string).collect();
        let wanted = wanted.join(" or ");
        let Some(found) = self.subdevices.get(subdevice as usize) else {
            let count = self.subdevices.len();
            let expected = format!("the number of a subdevice with {wanted}");
            let found = format!("{subdevice}, of {count} subdevices that count from 0");
            return Err(differs(key.to_owned(), expected, found));
        };
        if !kinds.contains(&found.kind) {
            let found = format!("subdevice {subdevice} with {}", found.kind);
            return Err(differs(key.to_owned(), format!("a subdevice with {wanted}"), found));
        }
        if channel >= found.channels {
            let expected = format!("a channel below {}", found.channels);
            let found = format!("{channel} of subdevice {subdevice}");
            return Err(differs(format!("{key}.channel"), expected, found));
        }
        Ok(*found)
    }

    /// Adds the device to an error of the kernel.
    pub fn refused(&self, doing: &'static str) -> impl FnOnce(Errno) -> ComediError {
        move |source| ComediError::Refused { device: self.path.clone(), doing, source }
    }

    /// Largest code of a channel.
    ///
    /// # Errors
    /// The kernel's.
    pub fn maxdata(&self, subdevice: &Subdevice, channel: u32) -> Result<u32> {
        if subdevice.info.flags & flag::MAXDATA_PER_CHANNEL == 0 {
            return Ok(subdevice.info.maxdata);
        }
        let all = call::channel_infos(self.as_fd(), subdevice.number, PerChannel::Maxdata)?;
        all.get(channel as usize).copied().ok_or(Errno::INVAL)
    }

    /// The ranges of a channel, by their index; `None` for one that is not in volts.
    ///
    /// # Errors
    /// The kernel's.
    pub fn ranges(&self, subdevice: &Subdevice, channel: u32) -> Result<Vec<Option<Range>>> {
        let maxdata = self.maxdata(subdevice, channel)?;
        let range_type = if subdevice.info.flags & flag::RANGE_PER_CHANNEL == 0 {
            subdevice.info.range_type
        } else {
            let all = call::channel_infos(self.as_fd(), subdevice.number, PerChannel::RangeType)?;
            all.get(channel as usize).copied().ok_or(Errno::INVAL)?
        };
        let ranges = call::ranges(self.as_fd(), range_type)?;
        Ok(ranges.iter().map(|range| Range::of_kernel(range, maxdata)).collect())
    }

    /// Keeps other open files from instructions and commands to a subdevice, until this one is
    /// closed.
    ///
    /// # Errors
    /// `EBUSY` where another has it.
    pub fn lock(&self, subdevice: u32) -> Result<()> {
        call::of_subdevice(self.as_fd(), number::LOCK, subdevice).map(drop)
    }

    /// Reads a channel once.
    ///
    /// # Errors
    /// The kernel's.
    pub fn read(&self, subdevice: u32, chanspec: u32) -> Result<u32> {
        let mut words = [0];
        self.instruct(uapi::insn::READ, subdevice, chanspec, &mut words)?;
        Ok(words[0])
    }

    /// Writes a code to a channel.
    ///
    /// # Errors
    /// The kernel's.
    pub fn write(&self, subdevice: u32, chanspec: u32, code: u32) -> Result<()> {
        self.instruct(uapi::insn::WRITE, subdevice, chanspec, &mut [code])
    }

    /// Sets the digital outputs in `mask` to `levels`, and returns the levels of all lines, one bit
    /// each.
    ///
    /// # Errors
    /// The kernel's.
    pub fn bits(&self, subdevice: u32, mask: u32, levels: u32) -> Result<u32> {
        let mut words = [mask, levels];
        self.instruct(uapi::insn::BITS, subdevice, 0, &mut words)?;
        Ok(words[1])
    }

    /// Configures a channel; the answer is in `words`.
    ///
    /// # Errors
    /// The kernel's.
    pub fn configure(&self, subdevice: u32, channel: u32, words: &mut [u32]) -> Result<()> {
        self.instruct(uapi::insn::CONFIG, subdevice, channel, words)
    }

    /// Makes a digital line an output, if it can be an input and is not an output yet.
    ///
    /// # Errors
    /// The kernel's.
    pub fn make_output(&self, subdevice: &Subdevice, channel: u32) -> Result<()> {
        if self.is_output(subdevice, channel)? {
            return Ok(());
        }
        self.configure(subdevice.number, channel, &mut [uapi::config::DIO_OUTPUT])
    }

    /// Whether a digital line is an output.
    ///
    /// # Errors
    /// The kernel's.
    pub fn is_output(&self, subdevice: &Subdevice, channel: u32) -> Result<bool> {
        if subdevice.kind != Kind::DigitalLines {
            return Ok(subdevice.kind == Kind::DigitalOutput);
        }
        let mut words = [uapi::config::DIO_QUERY, 0];
        self.configure(subdevice.number, channel, &mut words)?;
        Ok(words[1] == uapi::config::DIO_OUTPUT)
    }

    fn instruct(
        &self,
        instruction: u32,
        subdevice: u32,
        chanspec: u32,
        words: &mut [u32],
    ) -> Result<()> {
        let insn = Insn { instruction, subdevice, chanspec, ..Insn::default() };
        call::instruction(self.as_fd(), insn, words).map(drop)
    }
}

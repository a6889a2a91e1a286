//! Digital lines.

use rustix::io::Result;

use crate::device::{Device, Kind, Subdevice};
use crate::error::ComediError;

/// Lines that one instruction reaches.
const LINES: u32 = 32;

/// Kinds of subdevices with digital inputs.
pub const INPUTS: &[Kind] = &[Kind::DigitalInput, Kind::DigitalLines];
/// Kinds of subdevices with digital outputs.
pub const OUTPUTS: &[Kind] = &[Kind::DigitalOutput, Kind::DigitalLines];

/// Finds lines `first` to `first + count - 1` of a subdevice; `key` is the key of the rig file.
///
/// # Errors
/// [`ComediError::Differs`].
pub fn lines(
    device: &Device,
    key: &str,
    subdevice: u32,
    (first, count): (u32, u32),
    kinds: &[Kind],
) -> std::result::Result<Subdevice, ComediError> {
    let last = (first + count).saturating_sub(1);
    let found = device.expect(key, subdevice, last, kinds)?;
    if last >= LINES {
        return Err(ComediError::Differs {
            device: device.path().to_owned(),
            key: key.to_owned(),
            expected: format!("lines 0 to {} of a subdevice", LINES - 1),
            found: format!("line {last}"),
            advice: "take lower ones",
        });
    }
    Ok(found)
}

/// Checks that a line is an input. Many cards have lines whose direction changes with that of their
/// neighbours.
///
/// # Errors
/// [`ComediError::Differs`], or the kernel's.
pub fn expect_input(
    device: &Device,
    key: &str,
    subdevice: &Subdevice,
    channel: u32,
) -> std::result::Result<(), ComediError> {
    let is_output = device
        .is_output(subdevice, channel)
        .map_err(device.refused("asking for the direction of a digital line"))?;
    if !is_output {
        return Ok(());
    }
    Err(ComediError::Differs {
        device: device.path().to_owned(),
        key: key.to_owned(),
        expected: "an input".to_owned(),
        found: format!("line {channel} of subdevice {}, which is an output", subdevice.number),
        advice: "the card sets the direction of lines in groups: take one of another group",
    })
}

/// A digital output that this process alone switches. Other lines of its subdevice may be another
/// process's.
#[derive(Debug)]
pub struct OutputLine {
    device: Device,
    subdevice: Subdevice,
    channel: u32,
}

impl OutputLine {
    /// Opens a line and makes it an output where it is none yet. Its level is left as it is.
    ///
    /// # Errors
    /// When there is no such line, or the kernel refuses.
    pub fn open(
        path: &str,
        key: &str,
        subdevice: u32,
        channel: u32,
    ) -> std::result::Result<Self, ComediError> {
        let device = Device::open(path)?;
        let subdevice = lines(&device, key, subdevice, (channel, 1), OUTPUTS)?;
        device
            .make_output(&subdevice, channel)
            .map_err(device.refused("making a digital line an output"))?;
        Ok(Self { device, subdevice, channel })
    }

    /// Checks that a line of the same device is an input.
    ///
    /// # Errors
    /// When there is no such line, or it is an output.
    pub fn expect_input(
        &self,
        key: &str,
        subdevice: u32,
        channel: u32,
    ) -> std::result::Result<(), ComediError> {
        let found = lines(&self.device, key, subdevice, (channel, 1), INPUTS)?;
        expect_input(&self.device, key, &found, channel)
    }

    /// The level of the line.
    ///
    /// # Errors
    /// The kernel's.
    pub fn level(&self) -> Result<bool> {
        let levels = self.device.bits(self.subdevice.number, 0, 0)?;
        Ok(levels >> self.channel & 1 == 1)
    }

    /// Sets the level of the line.
    ///
    /// # Errors
    /// The kernel's.
    pub fn set(&self, high: bool) -> Result<()> {
        let bit = 1 << self.channel;
        self.device.bits(self.subdevice.number, bit, if high { bit } else { 0 }).map(drop)
    }
}

//! The kernel's interface as this crate uses it: `include/uapi/linux/comedi.h`, which is the same
//! in Linux 6.1 and 6.12. Pointers are integers here; [`crate::call`] alone fills them in.

/// Names within the kernel's structs have so many bytes.
const NAME: usize = 20;

/// Answer of `DEVINFO`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct DevInfo {
    pub(crate) version: u32,
    pub(crate) subdevices: u32,
    pub(crate) driver: [u8; NAME],
    pub(crate) board: [u8; NAME],
    pub(crate) read_subdevice: i32,
    pub(crate) write_subdevice: i32,
    pub(crate) unused: [i32; 30],
}

/// One element of the answer of `SUBDINFO`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct SubdInfo {
    pub(crate) kind: u32,
    pub(crate) channels: u32,
    pub(crate) flags: u32,
    pub(crate) timer_type: u32,
    pub(crate) chanlist_length: u32,
    pub(crate) maxdata: u32,
    pub(crate) channel_flags: u32,
    pub(crate) range_type: u32,
    pub(crate) settling_time: u32,
    pub(crate) bits_support: u32,
    pub(crate) unused: [u32; 8],
}

/// Argument of `CHANINFO`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ChanInfo {
    pub(crate) subdevice: u32,
    pub(crate) maxdata_list: usize,
    pub(crate) flag_list: usize,
    pub(crate) range_list: usize,
    pub(crate) unused: [u32; 4],
}

/// Argument of `RANGEINFO`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct RangeInfo {
    pub(crate) range_type: u32,
    pub(crate) ranges: usize,
}

/// A range: ends in millionths of the unit.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct KernelRange {
    pub(crate) least: i32,
    pub(crate) most: i32,
    pub(crate) flags: u32,
}

/// Argument of `DEVCONFIG`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub(crate) struct DevConfig {
    pub(crate) board: [u8; NAME],
    pub(crate) options: [i32; 32],
}

/// A streaming command.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Command {
    pub(crate) subdevice: u32,
    pub(crate) flags: u32,
    pub(crate) start_source: u32,
    pub(crate) start_argument: u32,
    pub(crate) scan_begin_source: u32,
    pub(crate) scan_begin_argument: u32,
    pub(crate) convert_source: u32,
    pub(crate) convert_argument: u32,
    pub(crate) scan_end_source: u32,
    pub(crate) scan_end_argument: u32,
    pub(crate) stop_source: u32,
    pub(crate) stop_argument: u32,
    pub(crate) chanlist: usize,
    pub(crate) chanlist_length: u32,
    pub(crate) data: usize,
    pub(crate) data_length: u32,
}

/// One instruction.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Insn {
    pub(crate) instruction: u32,
    pub(crate) words: u32,
    pub(crate) data: usize,
    pub(crate) subdevice: u32,
    pub(crate) chanspec: u32,
    pub(crate) unused: [u32; 3],
}

/// Argument of `INSNLIST`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct InsnList {
    pub(crate) length: u32,
    pub(crate) instructions: usize,
}

/// Argument of `BUFCONFIG`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct BufConfig {
    pub(crate) subdevice: u32,
    pub(crate) flags: u32,
    pub(crate) maximum_size: u32,
    pub(crate) size: u32,
    pub(crate) unused: [u32; 4],
}

/// Argument of `BUFINFO`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct BufInfo {
    pub(crate) subdevice: u32,
    pub(crate) bytes_read: u32,
    pub(crate) write_pointer: u32,
    pub(crate) read_pointer: u32,
    pub(crate) write_count: u32,
    pub(crate) read_count: u32,
    pub(crate) bytes_written: u32,
    pub(crate) unused: [u32; 4],
}

/// Flags of a subdevice.
pub(crate) mod flag {
    pub(crate) const MAXDATA_PER_CHANNEL: u32 = 0x10;
    pub(crate) const RANGE_PER_CHANNEL: u32 = 0x40;
    pub(crate) const COMMAND_READ: u32 = 0x8000;
    pub(crate) const SOFT_CALIBRATED: u32 = 0x2000;
    /// Samples have 32 bits, not 16.
    pub(crate) const LONG_SAMPLES: u32 = 0x1000_0000;
}

/// Sources of the events of a command.
pub(crate) mod source {
    pub(crate) const NONE: u32 = 1;
    pub(crate) const NOW: u32 = 2;
    pub(crate) const TIMER: u32 = 0x10;
    pub(crate) const COUNT: u32 = 0x20;
    pub(crate) const ANY: u32 = 0xffff_ffff;
}

/// Wakes, and on some cards delivers, at the end of each scan.
pub(crate) const WAKE_AT_END_OF_SCAN: u32 = 0x20;

/// Instructions.
pub(crate) mod insn {
    pub(crate) const READ: u32 = 0x400_0000;
    pub(crate) const WRITE: u32 = 0x800_0001;
    pub(crate) const BITS: u32 = 0xc00_0002;
    pub(crate) const CONFIG: u32 = 0xc00_0003;
}

/// First word of an instruction that configures.
pub(crate) mod config {
    pub(crate) const DIO_OUTPUT: u32 = 1;
    pub(crate) const DIO_QUERY: u32 = 28;
    pub(crate) const ARM: u32 = 31;
    pub(crate) const COUNTER_STATUS: u32 = 33;
    pub(crate) const RESET: u32 = 34;
    pub(crate) const GATE_SOURCE: u32 = 2001;
    pub(crate) const OTHER_SOURCE: u32 = 2005;
    pub(crate) const COUNTER_MODE: u32 = 4097;
}

/// A channel with its range and its analog reference (0 ground, 1 common, 2 differential, 3 other),
/// as instructions and commands name it.
pub const fn channel_spec(channel: u32, range: u32, reference: u32) -> u32 {
    (reference & 3) << 24 | (range & 0xff) << 16 | (channel & 0xffff)
}

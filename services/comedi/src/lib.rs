//! Linux's comedi interface to data acquisition cards, without a library: the kernel's calls, and
//! what a rig needs of a card.
//!
//! [`Device`] says what a card has and carries out single instructions, [`InstructionList`] several
//! in one call; [`Stream`] reads the scans that the card's timer takes, [`ScanClock`] estimates
//! when each was taken; [`Range`] converts codes and volts; [`CounterMode`] starts a counter at an
//! encoder and [`UnwrappedCount`] follows it round its range; [`OutputLine`] is a digital output.
//!
//! Streams are read by `read`, not by mapping the kernel's buffer: a read takes no lock of the
//! device, returns no sample that the driver has not finished, and needs no unsafe code. All unsafe
//! code is in one file, `call.rs`.
#![deny(unsafe_code)]

#[allow(unsafe_code)]
mod call;
mod counter;
mod device;
mod digital;
mod error;
mod instructions;
mod range;
mod scan_bytes;
mod scan_clock;
mod stream;
mod uapi;

pub use counter::{CounterMode, Edges, UnwrappedCount, interpolated};
pub use device::{Device, Kind, Subdevice};
pub use digital::{INPUTS, OUTPUTS, OutputLine, expect_input, lines};
pub use error::ComediError;
pub use instructions::{InstructionList, Place};
pub use range::{Range, narrowest};
pub use rustix::io::Errno;
pub use scan_bytes::ScanBytes;
pub use scan_clock::ScanClock;
pub use stream::{Fetched, Stream, StreamSettings};
pub use uapi::channel_spec;

#[cfg(test)]
mod tests {
    use crate::call::number;
    use crate::uapi::{
        BufConfig, BufInfo, ChanInfo, Command, DevConfig, DevInfo, Insn, InsnList, KernelRange,
        RangeInfo, SubdInfo,
    };

    /// Numbers and sizes as a C compiler makes them of the kernel's header, on x86_64.
    #[test]
    fn calls_and_structs_are_the_kernels() {
        let calls = [
            (number::DEVCONFIG, 0x4094_6400, size_of::<DevConfig>(), 148),
            (number::DEVINFO, 0x80b0_6401, size_of::<DevInfo>(), 176),
            (number::SUBDINFO, 0x8048_6402, size_of::<SubdInfo>(), 72),
            (number::CHANINFO, 0x8030_6403, size_of::<ChanInfo>(), 48),
            (number::RANGEINFO, 0x8010_6408, size_of::<RangeInfo>(), 16),
            (number::CMD, 0x8050_6409, size_of::<Command>(), 80),
            (number::CMDTEST, 0x8050_640a, size_of::<Command>(), 80),
            (number::INSNLIST, 0x8010_640b, size_of::<InsnList>(), 16),
            (number::INSN, 0x8028_640c, size_of::<Insn>(), 40),
            (number::BUFCONFIG, 0x8020_640d, size_of::<BufConfig>(), 32),
            (number::BUFINFO, 0xc02c_640e, size_of::<BufInfo>(), 44),
        ];
        for (number, expected, size, bytes) in calls {
            assert_eq!((number, size), (expected, bytes), "{expected:#x}");
        }
        let plain = [
            (number::LOCK, 0x6405),
            (number::CANCEL, 0x6407),
            (number::POLL, 0x640f),
            (number::SETRSUBD, 0x6410),
        ];
        for (number, expected) in plain {
            assert_eq!(number, expected);
        }
        assert_eq!(size_of::<KernelRange>(), 12);
        assert_eq!(std::mem::offset_of!(Command, chanlist), 48);
        assert_eq!(std::mem::offset_of!(Command, data), 64);
        assert_eq!(std::mem::offset_of!(Insn, subdevice), 16);
        assert_eq!(std::mem::offset_of!(ChanInfo, maxdata_list), 8);
    }

    #[test]
    fn a_channel_is_packed_with_range_and_reference() {
        assert_eq!(crate::channel_spec(5, 2, 3), 0x0302_0005);
    }
}

//! Calls of the kernel: all of the crate's unsafe code.
//!
//! The arguments that contain pointers are completed here, from slices that live until the call
//! returns; every function keeps to the sizes that the kernel's `comedi_fops.c` reads and writes.

use std::ffi::c_void;
use std::os::fd::BorrowedFd;
use std::ptr::without_provenance_mut;

use rustix::io::{Errno, Result};
use rustix::ioctl::{Ioctl, IoctlOutput, Opcode, ioctl, opcode};

use crate::uapi::{
    BufConfig, BufInfo, ChanInfo, Command, DevConfig, DevInfo, Insn, InsnList, KernelRange,
    RangeInfo, SubdInfo,
};

const GROUP: u8 = b'd';

/// Numbers of the calls. The directions of four of them are not what the kernel does with the
/// argument, but they are what its header says.
pub(crate) mod number {
    use super::*;

    pub(crate) const DEVCONFIG: Opcode = opcode::write::<DevConfig>(GROUP, 0);
    pub(crate) const DEVINFO: Opcode = opcode::read::<DevInfo>(GROUP, 1);
    pub(crate) const SUBDINFO: Opcode = opcode::read::<SubdInfo>(GROUP, 2);
    pub(crate) const CHANINFO: Opcode = opcode::read::<ChanInfo>(GROUP, 3);
    pub(crate) const LOCK: Opcode = opcode::none(GROUP, 5);
    pub(crate) const CANCEL: Opcode = opcode::none(GROUP, 7);
    pub(crate) const RANGEINFO: Opcode = opcode::read::<RangeInfo>(GROUP, 8);
    pub(crate) const CMD: Opcode = opcode::read::<Command>(GROUP, 9);
    pub(crate) const CMDTEST: Opcode = opcode::read::<Command>(GROUP, 10);
    pub(crate) const INSNLIST: Opcode = opcode::read::<InsnList>(GROUP, 11);
    pub(crate) const INSN: Opcode = opcode::read::<Insn>(GROUP, 12);
    pub(crate) const BUFCONFIG: Opcode = opcode::read::<BufConfig>(GROUP, 13);
    pub(crate) const BUFINFO: Opcode = opcode::read_write::<BufInfo>(GROUP, 14);
    pub(crate) const POLL: Opcode = opcode::none(GROUP, 15);
    pub(crate) const SETRSUBD: Opcode = opcode::none(GROUP, 16);
}

/// A call with its argument; its return value is handed on.
struct Call {
    opcode: Opcode,
    argument: *mut c_void,
}

// SAFETY: only the functions of this file make a `Call`, each with the argument that the kernel
// expects for that number; the kernel may write to it, as `IS_MUTATING` says.
unsafe impl Ioctl for Call {
    type Output = IoctlOutput;
    const IS_MUTATING: bool = true;

    fn opcode(&self) -> Opcode {
        self.opcode
    }

    fn as_ptr(&mut self) -> *mut c_void {
        self.argument
    }

    unsafe fn output_from_ptr(returned: IoctlOutput, _: *mut c_void) -> Result<IoctlOutput> {
        Ok(returned)
    }
}

/// A call whose argument is a subdevice's number, not a pointer.
pub(crate) fn of_subdevice(
    device: BorrowedFd<'_>,
    opcode: Opcode,
    subdevice: u32,
) -> Result<IoctlOutput> {
    let takes_number = [number::LOCK, number::CANCEL, number::POLL, number::SETRSUBD];
    if !takes_number.contains(&opcode) {
        return Err(Errno::INVAL);
    }
    let argument = without_provenance_mut(subdevice as usize);
    // SAFETY: the kernel takes the argument of these calls as an integer and touches no memory.
    unsafe { ioctl(device, Call { opcode, argument }) }
}

/// A call whose argument is a struct.
///
/// # Safety
/// `T` is the struct that the number of the call is made of, and each address in it is that of
/// memory of which the call reads and writes no more than the caller has there.
unsafe fn with_struct<T>(
    device: BorrowedFd<'_>,
    opcode: Opcode,
    argument: &mut T,
) -> Result<IoctlOutput> {
    let argument = std::ptr::from_mut(argument).cast();
    // SAFETY: as the caller promises.
    unsafe { ioctl(device, Call { opcode, argument }) }
}

pub(crate) fn device_info(device: BorrowedFd<'_>) -> Result<DevInfo> {
    let mut info = DevInfo::default();
    // SAFETY: the struct of the call, without addresses.
    unsafe { with_struct(device, number::DEVINFO, &mut info) }?;
    Ok(info)
}

pub(crate) fn buffer_config(device: BorrowedFd<'_>, config: &mut BufConfig) -> Result<()> {
    // SAFETY: the struct of the call, without addresses.
    unsafe { with_struct(device, number::BUFCONFIG, config) }.map(drop)
}

pub(crate) fn buffer_info(device: BorrowedFd<'_>, info: &mut BufInfo) -> Result<()> {
    // SAFETY: the struct of the call, without addresses.
    unsafe { with_struct(device, number::BUFINFO, info) }.map(drop)
}

/// Attaches a driver to a device node, or detaches it.
pub(crate) fn configure(device: BorrowedFd<'_>, config: Option<&mut DevConfig>) -> Result<()> {
    let opcode = number::DEVCONFIG;
    match config {
        Some(config) => {
            // SAFETY: the struct of the call, without addresses (the kernel refuses firmware).
            unsafe { with_struct(device, opcode, config) }.map(drop)
        }
        None => {
            let argument = std::ptr::null_mut();
            // SAFETY: without an argument the kernel touches no memory.
            unsafe { ioctl(device, Call { opcode, argument }) }.map(drop)
        }
    }
}

/// All subdevices, of which there must be `count` (as [`device_info`] says).
pub(crate) fn subdevice_infos(device: BorrowedFd<'_>) -> Result<Vec<SubdInfo>> {
    let count = device_info(device)?.subdevices as usize;
    let mut infos = vec![SubdInfo::default(); count];
    let call = Call { opcode: number::SUBDINFO, argument: infos.as_mut_ptr().cast() };
    // SAFETY: the kernel writes one element for each subdevice of the attached driver, of which it
    // has just said the number. A driver that is exchanged between the two calls might have more:
    // that takes root, and the card's removal, while this program starts.
    unsafe { ioctl(device, call) }?;
    Ok(infos)
}

/// What differs from channel to channel of a subdevice.
#[derive(Clone, Copy)]
pub(crate) enum PerChannel {
    /// The largest code.
    Maxdata,
    /// The range type.
    RangeType,
}

/// A word for each channel of a subdevice.
pub(crate) fn channel_infos(
    device: BorrowedFd<'_>,
    subdevice: u32,
    what: PerChannel,
) -> Result<Vec<u32>> {
    let infos = subdevice_infos(device)?;
    let channels = infos.get(subdevice as usize).ok_or(Errno::INVAL)?.channels;
    let mut words = vec![0; channels as usize];
    let address = words.as_mut_ptr().expose_provenance();
    let mut info = ChanInfo { subdevice, ..ChanInfo::default() };
    match what {
        PerChannel::Maxdata => info.maxdata_list = address,
        PerChannel::RangeType => info.range_list = address,
    }
    // SAFETY: the struct of the call; the kernel writes a word for each channel, of which it has
    // just said the number.
    unsafe { with_struct(device, number::CHANINFO, &mut info) }?;
    Ok(words)
}

/// The ranges of a range type, whose low half is their number.
pub(crate) fn ranges(device: BorrowedFd<'_>, range_type: u32) -> Result<Vec<KernelRange>> {
    let mut ranges = vec![KernelRange::default(); (range_type & 0xffff) as usize];
    let mut info = RangeInfo { range_type, ranges: ranges.as_mut_ptr().expose_provenance() };
    // SAFETY: the struct of the call; the kernel refuses a number of ranges that is not its own.
    unsafe { with_struct(device, number::RANGEINFO, &mut info) }?;
    Ok(ranges)
}

/// Tests a command (the stage at which it failed, or 0; the kernel corrects it), or starts it.
pub(crate) fn command(
    device: BorrowedFd<'_>,
    opcode: Opcode,
    command: &mut Command,
    chanlist: &mut [u32],
) -> Result<IoctlOutput> {
    if opcode != number::CMD && opcode != number::CMDTEST {
        return Err(Errno::INVAL);
    }
    command.chanlist = chanlist.as_mut_ptr().expose_provenance();
    command.chanlist_length = chanlist.len() as u32;
    command.data = 0;
    command.data_length = 0;
    // SAFETY: the struct of the call; the kernel reads the list, of the given length.
    let result = unsafe { with_struct(device, opcode, command) };
    command.chanlist = 0;
    result
}

/// Carries out one instruction, whose words the kernel reads and writes.
pub(crate) fn instruction(
    device: BorrowedFd<'_>,
    mut insn: Insn,
    words: &mut [u32],
) -> Result<IoctlOutput> {
    insn.words = words.len() as u32;
    insn.data = words.as_mut_ptr().expose_provenance();
    // SAFETY: the struct of the call; the kernel reads and writes the given number of words.
    unsafe { with_struct(device, number::INSN, &mut insn) }
}

/// Carries out instructions one after another: all, or an error at the first that fails. The words
/// of each follow each other in `words`; [`Insn::words`] says how many each has.
pub(crate) fn instructions(
    device: BorrowedFd<'_>,
    list: &mut [Insn],
    words: &mut [u32],
) -> Result<()> {
    let mut rest = words;
    for insn in list.iter_mut() {
        let own = rest.split_off_mut(..insn.words as usize).ok_or(Errno::INVAL)?;
        insn.data = own.as_mut_ptr().expose_provenance();
    }
    let (length, instructions) = (list.len() as u32, list.as_mut_ptr().expose_provenance());
    let mut argument = InsnList { length, instructions };
    // SAFETY: the struct of the call; the kernel reads `length` instructions, and reads and writes
    // the words of each, which lie within `words`.
    let done = unsafe { with_struct(device, number::INSNLIST, &mut argument) }?;
    if done == length as IoctlOutput { Ok(()) } else { Err(Errno::IO) }
}

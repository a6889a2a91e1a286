//! Instructions that are carried out together, again and again.

use std::os::fd::AsFd;

use rustix::io::Result;

use crate::call;
use crate::device::Device;
use crate::uapi::{self, Insn};

/// Instructions to one device that are carried out in one call, under the device's one lock. They
/// are listed once; carrying them out allocates nothing.
#[derive(Debug, Default)]
pub struct InstructionList {
    instructions: Vec<Insn>,
    words: Vec<u32>,
}

/// Place of an instruction's word within its list.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place(usize);

impl InstructionList {
    /// Reads a channel; the place is that of its code.
    pub fn read(&mut self, subdevice: u32, chanspec: u32) -> Place {
        self.add(uapi::insn::READ, subdevice, chanspec, &[0])
    }

    /// Writes a channel; the place is that of its code.
    pub fn write(&mut self, subdevice: u32, chanspec: u32, code: u32) -> Place {
        self.add(uapi::insn::WRITE, subdevice, chanspec, &[code])
    }

    /// Sets the digital outputs in `mask` and reads all lines; the place is that of the levels, one
    /// bit each, which are replaced by those that were read.
    pub fn bits(&mut self, subdevice: u32, mask: u32) -> Place {
        let Place(first) = self.add(uapi::insn::BITS, subdevice, 0, &[mask, 0]);
        Place(first + 1)
    }

    fn add(&mut self, instruction: u32, subdevice: u32, chanspec: u32, words: &[u32]) -> Place {
        let place = Place(self.words.len());
        let count = words.len() as u32;
        let insn = Insn { instruction, words: count, subdevice, chanspec, ..Insn::default() };
        self.instructions.push(insn);
        self.words.extend_from_slice(words);
        place
    }

    /// The word at a place; 0 for a place of another list.
    pub fn word(&self, place: Place) -> u32 {
        self.words.get(place.0).copied().unwrap_or_default()
    }

    /// Sets the word at a place.
    pub fn set(&mut self, place: Place, word: u32) {
        if let Some(at) = self.words.get_mut(place.0) {
            *at = word;
        }
    }

    /// Whether there is nothing to carry out.
    pub fn is_empty(&self) -> bool {
        self.instructions.is_empty()
    }

    /// Carries all out, in their order.
    ///
    /// # Errors
    /// The kernel's, at the first that fails.
    pub fn run(&mut self, device: &Device) -> Result<()> {
        if self.is_empty() {
            return Ok(());
        }
        call::instructions(device.as_fd(), &mut self.instructions, &mut self.words)
    }
}

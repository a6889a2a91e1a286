//! The enable line that this process switches: a line of its own making, and in the virtual machine
//! of `.ci/comedi_qemu.py` one of the kernel's `comedi_parport`.
#![allow(clippy::unwrap_used)]

use std::cell::{Cell, RefCell};
use std::rc::Rc;

use comedi::{Device, Errno};
use ipc_types::CardKind;
use rig::RigFile;
use watchdog::enable_output::{EnableOutput, Line, LineError};

const RIG: &str = include_str!("../../../launch/rig/tests/comedi.toml");

/// What happened at a line.
#[derive(Clone, Default)]
struct Recorded(Rc<RefCell<Vec<bool>>>);

struct FakeLine {
    high: Cell<bool>,
    edges_left: Cell<usize>,
    recorded: Recorded,
}

impl FakeLine {
    fn new(high: bool, edges: usize, recorded: &Recorded) -> Self {
        Self { high: Cell::new(high), edges_left: Cell::new(edges), recorded: recorded.clone() }
    }
}

impl Line for FakeLine {
    fn level(&self) -> Result<bool, Errno> {
        Ok(self.high.get())
    }

    fn set(&self, high: bool) -> Result<(), Errno> {
        let left = self.edges_left.get().checked_sub(1).ok_or(Errno::IO)?;
        self.edges_left.set(left);
        self.high.set(high);
        self.recorded.0.borrow_mut().push(high);
        Ok(())
    }
}

#[test]
fn a_line_goes_on_from_the_level_that_it_has() {
    for high in [false, true] {
        let recorded = Recorded::default();
        let mut output = EnableOutput::new(FakeLine::new(high, 9, &recorded)).unwrap();
        assert!(recorded.0.borrow().is_empty(), "taking it up makes no edge");
        output.toggle().unwrap();
        output.toggle().unwrap();
        drop(output);
        assert_eq!(*recorded.0.borrow(), [!high, high], "nor does its end");
    }
}

#[test]
fn a_line_that_is_lost_makes_no_more_edges() {
    let recorded = Recorded::default();
    let mut output = EnableOutput::new(FakeLine::new(false, 1, &recorded)).unwrap();
    output.toggle().unwrap();
    for _ in 0..3 {
        assert!(matches!(output.toggle(), Err(LineError::Lost(Errno::IO))));
    }
    assert_eq!(*recorded.0.borrow(), [true]);
}

#[test]
fn only_a_comedi_card_has_a_line_of_this_process() {
    let rig = RigFile::parse(RIG, "rig.toml").unwrap();
    for card in [None, Some(CardKind::Simulated), Some(CardKind::Replay), Some(CardKind::Null)] {
        assert!(EnableOutput::of_rig(card, &rig).unwrap().is_none());
    }
    let rig = rig::load_rig("hydrostatic".as_ref()).unwrap();
    assert!(EnableOutput::of_rig(Some(CardKind::Comedi), &rig).unwrap().is_none());
}

#[test]
fn a_line_that_is_not_there_is_told_by_its_device() {
    let rig = RigFile::parse(&RIG.replace("comedi0", "comedi-none"), "rig.toml").unwrap();
    let error = EnableOutput::of_rig(Some(CardKind::Comedi), &rig).unwrap_err().to_string();
    assert!(error.starts_with("/dev/comedi-none: cannot be opened"), "{error}");
}

/// On the kernel's driver. Another open file switches other lines of the port meanwhile, as
/// acquisition may; two watchdogs, one after the other, make no edge between them.
#[test]
fn a_line_of_the_parallel_port() {
    if std::env::var_os("FARREACH_COMEDI").is_none() {
        eprintln!("SKIPPED: needs the kernel's comedi drivers: .ci/comedi_qemu.py");
        return;
    }
    Device::attach("/dev/comedi0", "comedi_parport", &[0x378]).unwrap();
    let rig = RigFile::parse(RIG, "rig.toml").unwrap();
    let port = Device::open("/dev/comedi0").unwrap();
    let level = || port.bits(2, 0, 0).unwrap() & 1;
    let mut expected = 0;
    for _ in 0..3 {
        let mut output = EnableOutput::of_rig(Some(CardKind::Comedi), &rig).unwrap().unwrap();
        assert_eq!(level(), expected, "taking it up makes no edge");
        for edge in 0..101 {
            output.toggle().unwrap();
            expected ^= 1;
            port.bits(2, 0b1110, edge << 1).unwrap();
            assert_eq!(port.bits(2, 0, 0).unwrap(), expected | edge << 1 & 0b1110);
        }
        drop(output);
        assert_eq!(level(), expected, "nor does its end");
    }
    // A line that cannot be an output.
    let wrong = RIG.replace(
        "[comedi.enable_line]\ndevice = \"/dev/comedi0\"\nsubdevice = 2\nchannel = 0",
        "[comedi.enable_line]\ndevice = \"/dev/comedi2\"\nsubdevice = 0\nchannel = 0",
    );
    let rig = RigFile::parse(&wrong, "rig.toml").unwrap();
    let error = EnableOutput::of_rig(Some(CardKind::Comedi), &rig).unwrap_err().to_string();
    assert!(error.contains("comedi.enable_line: expected a subdevice with digital"), "{error}");
}

//! The virtual machine's devices: `/dev/comedi0` is the parallel port, `/dev/comedi1` a
//! `comedi_test` whose outputs stand for counters, `/dev/comedi2` a `comedi_test` with a sawtooth
//! and a square wave of ±10 V and 0.1 s.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::path::Path;
use std::sync::Once;
use std::time::Duration;

use acquisition::{CheckedComedi, ComediDaq};
use comedi::{ComediError, Device, channel_spec};
use rig::RigFile;
use runtime::clock::now_ns;
use runtime::daq::{Daq, Scan};

use crate::conformance::Bench;

thread_local! {
    static ALLOCATIONS: Cell<usize> = const { Cell::new(0) };
}

/// Counts what this thread allocates.
struct Counting;

// SAFETY: hands everything to the system's allocator and only counts besides.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.with(|count| count.set(count.get() + 1));
        // SAFETY: the caller keeps the contract of `GlobalAlloc::alloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the pointer came from `System` through `alloc`.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Number of allocations of this thread so far.
pub(crate) fn allocations() -> usize {
    ALLOCATIONS.with(Cell::get)
}

/// The rig file for these devices.
pub(crate) const RIG: &str = include_str!("../../../../launch/rig/tests/comedi.toml");

/// Whether this is the virtual machine; attaches the drivers that do not do so themselves.
pub(crate) fn is_guest() -> bool {
    static ATTACHED: Once = Once::new();
    if std::env::var_os("FARREACH_COMEDI").is_none() {
        eprintln!("SKIPPED: needs the kernel's comedi drivers: .ci/comedi_qemu.py");
        return false;
    }
    ATTACHED.call_once(|| {
        Device::attach("/dev/comedi0", "comedi_parport", &[0x378]).unwrap();
        Device::attach("/dev/comedi1", "comedi_test", &[1_000_000, 100_000]).unwrap();
    });
    true
}

pub(crate) fn rig(text: &str) -> RigFile {
    RigFile::parse(text, "guest.toml").unwrap()
}

fn open(rig: &RigFile) -> Result<CheckedComedi, ComediError> {
    CheckedComedi::open(rig, rig.comedi.as_ref().unwrap())
}

pub(crate) fn checked(text: &str) -> Result<CheckedComedi, ComediError> {
    open(&rig(text))
}

pub(crate) fn start(text: &str, directory: Option<&Path>) -> ComediDaq {
    checked(text).unwrap().start(directory).unwrap()
}

pub(crate) fn wait(milliseconds: u64) {
    std::thread::sleep(Duration::from_millis(milliseconds));
}

/// Reads until so many scans have come.
pub(crate) fn stream(daq: &mut ComediDaq, scans: usize) -> Vec<Scan> {
    let mut seen = Vec::new();
    while seen.len() < scans {
        seen.extend(daq.read_due(0).unwrap());
        wait(1);
    }
    seen
}

/// Outputs that stand for the counters of master and slave.
pub(crate) struct Encoders(Device);

impl Encoders {
    pub(crate) fn open() -> Self {
        Self(Device::open("/dev/comedi1").unwrap())
    }

    /// What the counters show.
    pub(crate) fn show(&self, master: u32, slave: u32) {
        for (channel, code) in [(0, master), (1, slave)] {
            self.0.write(1, channel_spec(channel, 0, 0), code).unwrap();
        }
    }
}

/// The card on the bench, which waits for the card's own clock.
pub(crate) struct ComediBench {
    rig: RigFile,
    period: Duration,
    daq: Option<ComediDaq>,
}

impl ComediBench {
    pub(crate) fn new(rig: RigFile) -> Self {
        let period = Duration::from_nanos(rig.rates.acquisition_period_ns());
        let daq = open(&rig).unwrap().start(None).unwrap();
        Self { rig, period, daq: Some(daq) }
    }
}

impl Bench for ComediBench {
    fn reset(&mut self) {
        // Two at once are refused.
        self.daq = None;
        self.daq = Some(open(&self.rig).unwrap().start(None).unwrap());
    }

    fn advance(&mut self, ticks: u64) {
        // Until the last of the scans is there: the kernel delivers in bursts. Where the buffer
        // overruns it never comes.
        let limit = self.period * ticks as u32 + Duration::from_millis(100);
        self.daq.as_ref().unwrap().wait_for(ticks as usize, limit);
    }

    fn now_ns(&self) -> u64 {
        now_ns()
    }

    fn daq(&mut self) -> &mut dyn Daq {
        self.daq.as_mut().unwrap()
    }

    fn resolution_v(&self) -> f64 {
        self.daq.as_ref().unwrap().resolution_v()
    }
}

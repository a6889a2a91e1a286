//! A card that Linux's comedi drivers know.
//!
//! The card's own timer scans the analog inputs into the kernel's buffer, from which each call
//! takes what is there. Encoders and digital inputs are read with each batch of scans: the newest
//! scan has them, older ones of a batch have counts on the straight line between two readings. A
//! sensor whose line reports a fault is absent. When the buffer has overrun, the stream is started
//! again and the hole is counted.

mod boards;
mod digital;
mod power_up;
mod wiring;

use std::path::Path;
use std::time::Duration;

use comedi::{ComediError, Fetched, ScanClock, interpolated};
use ipc_types::{AXES, Capabilities, CardKind};
use rig::{ComediCard, RigFile};
use runtime::clock::{SECOND_NS, now_ns};
use runtime::daq::{Daq, DaqError, Present, Scan};

use self::wiring::{FIFO, Wiring};
use super::null::only_zero;

/// Restarts of the stream within a second; more are a fault.
const RESTARTS: u32 = 3;

/// How often the stream was restarted within the last second or so.
#[derive(Clone, Copy, Debug, Default)]
struct Restarts {
    count: u32,
    since_ns: u64,
}

impl Restarts {
    /// Counts one more; false if they are too many.
    fn allow(&mut self, now_ns: u64) -> bool {
        if self.count == 0 || now_ns.saturating_sub(self.since_ns) > SECOND_NS {
            *self = Self { count: 0, since_ns: now_ns };
        }
        self.count += 1;
        self.count <= RESTARTS
    }
}

/// What is read with each batch of scans.
#[derive(Clone, Copy, Debug, Default)]
struct Reading {
    /// Tick of the newest scan of the batch.
    tick: u64,
    master: [i64; AXES],
    slave: [i64; AXES],
    digital_in: u32,
    motor_power: bool,
    /// What has reported no fault.
    present: Present,
}

/// Volts that were written, and since when.
#[derive(Clone, Copy, Debug, Default)]
struct Written {
    volts: [f64; AXES],
    since_ns: u64,
}

/// A card that was checked against the rig file.
#[derive(Debug)]
pub struct CheckedComedi {
    wiring: Wiring,
    present: Present,
    readbacks: [Option<usize>; AXES],
}

impl CheckedComedi {
    /// Opens the card and checks that it has what the rig file says. Changes nothing, so that it
    /// also works while a rig runs with the card.
    ///
    /// # Errors
    /// With key, expected and found.
    pub fn open(rig: &RigFile, card: &ComediCard) -> Result<Self, ComediError> {
        let mut readbacks = [None; AXES];
        for (to, axis) in readbacks.iter_mut().zip(&card.axes) {
            *to = axis.readback;
        }
        let is_read_back = |(at, own): (usize, &Option<usize>)| u8::from(own.is_some()) << at;
        Ok(Self {
            wiring: Wiring::check(rig, card)?,
            present: Present {
                master: rig.axis_bits(|_| true),
                slave: rig.axis_bits(|axis| axis.slave.is_some()),
                motor: readbacks.iter().enumerate().map(is_read_back).sum(),
                analog: rig.channel_bits(),
            },
            readbacks,
        })
    }

    /// Takes the card for this process and starts its stream. `directory` keeps what tells a
    /// successor that the counters were never stopped; without it they always start anew.
    ///
    /// # Errors
    /// When another process has the card, or the kernel refuses.
    pub fn start(self, directory: Option<&Path>) -> Result<ComediDaq, ComediError> {
        let Self { mut wiring, present, readbacks } = self;
        let power_up = wiring.start(directory)?;
        Ok(ComediDaq {
            clock: ScanClock::new(wiring.stream.period_ns()),
            wiring,
            batch: Vec::with_capacity(FIFO + 1),
            present,
            readbacks,
            power_up,
            last_tick: None,
            begins: true,
            reading: None,
            written: Written::default(),
            written_before: Written::default(),
            digital_out: None,
            missed: 0,
            restarts: Restarts::default(),
        })
    }
}

/// A comedi card, as acquisition sees it.
#[derive(Debug)]
pub struct ComediDaq {
    wiring: Wiring,
    clock: ScanClock,
    batch: Vec<Scan>,
    present: Present,
    readbacks: [Option<usize>; AXES],
    power_up: u64,
    last_tick: Option<u64>,
    /// Whether the next scan is the first of a stream.
    begins: bool,
    reading: Option<Reading>,
    written: Written,
    written_before: Written,
    /// Levels of the digital outputs; `None` until they were set.
    digital_out: Option<u32>,
    missed: u64,
    restarts: Restarts,
}

impl ComediDaq {
    /// Volts between two codes of the coarsest output (V).
    pub fn resolution_v(&self) -> f64 {
        self.wiring.resolution_v
    }

    /// What the driver says of the outputs (V): what it put out last, not a measurement.
    ///
    /// # Errors
    /// [`DaqError::Link`].
    pub fn held_v(&self) -> Result<[f64; AXES], DaqError> {
        self.wiring.held_v().map_err(|_| DaqError::Link("reading outputs"))
    }

    /// Waits until the kernel's buffer has so many scans; false if it has not within `limit`.
    pub fn wait_for(&self, scans: usize, limit: Duration) -> bool {
        let end = now_ns() + limit.as_nanos() as u64;
        loop {
            if self.wiring.stream.waiting(self.wiring.card()).is_ok_and(|found| found >= scans) {
                return true;
            }
            if now_ns() >= end {
                return false;
            }
            std::thread::sleep(Duration::from_micros(500));
        }
    }

    /// Counts and levels, for the scan of that tick.
    fn read(&mut self, tick: u64) -> Result<Reading, DaqError> {
        self.wiring.read().map_err(|_| DaqError::Link("reading counters and digital inputs"))?;
        let [master, slave] = self.wiring.counts();
        let Wiring { boards, digital, .. } = &self.wiring;
        Ok(Reading {
            tick,
            master,
            slave,
            digital_in: digital.levels(boards),
            motor_power: digital.motor_power(boards),
            present: digital.without_faults(boards, self.present),
        })
    }

    /// Takes the whole scans that were read from the stream by `now_ns`.
    fn take_scans(&mut self, now_ns: u64) -> Result<(), DaqError> {
        let count = self.wiring.stream.scans();
        if count == 0 {
            return Ok(());
        }
        self.clock.delivered(count as u64, now_ns);
        for _ in 0..count {
            let time_ns = self.clock.next_ns();
            let tick = self.next_tick(time_ns);
            let mut scan = Scan {
                tick,
                time_ns,
                digital_out: self.digital_out.unwrap_or_default(),
                power_up: self.power_up,
                ..Scan::default()
            };
            let Some(codes) = self.wiring.stream.next_scan() else { break };
            for (input, code) in self.wiring.inputs.iter().zip(codes) {
                if let Some(to) = scan.analog_v.get_mut(input.index) {
                    *to = input.volts(code);
                }
            }
            let newest = time_ns >= self.written.since_ns;
            let written = if newest { &self.written } else { &self.written_before };
            scan.motor_v = written.volts;
            for (to, readback) in scan.motor_v.iter_mut().zip(self.readbacks) {
                if let Some(volts) = readback.and_then(|index| scan.analog_v.get(index)) {
                    *to = *volts;
                }
            }
            self.batch.push(scan);
        }
        let Some(newest) = self.last_tick else { return Ok(()) };
        let reading = self.read(newest)?;
        let before = self.reading.unwrap_or(reading);
        for scan in &mut self.batch {
            let at = |from: i64, to: i64| {
                interpolated((before.tick, from), (reading.tick, to), scan.tick)
            };
            scan.master_counts = std::array::from_fn(|i| at(before.master[i], reading.master[i]));
            scan.slave_counts = std::array::from_fn(|i| at(before.slave[i], reading.slave[i]));
            let levels = if scan.tick == newest { &reading } else { &before };
            scan.digital_in = levels.digital_in;
            scan.motor_power = levels.motor_power;
            // What lies between two readings is as good as the worse of them.
            scan.present = levels.present.and(reading.present);
        }
        self.reading = Some(reading);
        Ok(())
    }

    /// Ticks count scans. The first of a stream is that of its time, or the one after the last; the
    /// ticks between are of scans that nobody read.
    fn next_tick(&mut self, time_ns: u64) -> u64 {
        let following = self.last_tick.map(|last| last + 1);
        let tick = match following {
            Some(tick) if !self.begins => tick,
            _ => (time_ns / self.wiring.stream.period_ns()).max(following.unwrap_or(0)),
        };
        self.missed += following.map_or(0, |following| tick - following);
        self.begins = false;
        self.last_tick = Some(tick);
        tick
    }

    /// Starts the stream again after it has stopped.
    fn restart(&mut self, now_ns: u64) -> Result<(), DaqError> {
        if !self.restarts.allow(now_ns) {
            return Err(DaqError::Link("its stream stops again and again"));
        }
        let Wiring { boards, stream, .. } = &mut self.wiring;
        let card = boards.first().ok_or(DaqError::Link("no device"))?;
        stream.start(&card.device).map_err(|_| DaqError::Link("starting its stream again"))?;
        self.clock.restart();
        self.begins = true;
        Ok(())
    }
}

impl Daq for ComediDaq {
    fn kind(&self) -> CardKind {
        CardKind::Comedi
    }

    fn capabilities(&self) -> Capabilities {
        let own = self.kind().capabilities();
        let has_outputs = !self.wiring.outputs.is_empty();
        Capabilities {
            accepts_output: has_outputs,
            digital_outputs: self.wiring.digital.outputs(),
            enable_line: own.enable_line.filter(|_| has_outputs),
            reports_power: own.reports_power
                && has_outputs
                && self.wiring.digital.sees_motor_power(),
            ..own
        }
    }

    fn read_due(&mut self, _now_ns: u64) -> Result<&[Scan], DaqError> {
        self.batch.clear();
        let Wiring { boards, stream, .. } = &mut self.wiring;
        let card = boards.first().ok_or(DaqError::Link("no device"))?;
        let fetched = stream.fetch(&card.device).map_err(|_| DaqError::Link("reading scans"))?;
        // After the read: no scan is of the future.
        let now_ns = now_ns();
        self.take_scans(now_ns)?;
        if fetched == Fetched::Stopped {
            self.restart(now_ns)?;
        }
        Ok(&self.batch)
    }

    fn taken(&mut self, _tick: u64) {
        // The kernel drops the buffer with the process that filled it.
    }

    fn write(&mut self, volts: [f64; AXES]) -> Result<(), DaqError> {
        if self.wiring.outputs.is_empty() {
            return only_zero(volts);
        }
        let finite = volts.iter().all(|v| v.is_finite());
        let unused = self.wiring.outputs.len()..AXES;
        if finite && volts[unused].iter().any(|v| *v != 0.0) {
            return Err(DaqError::NoOutput);
        }
        let mut given = [0.0; AXES];
        let Wiring { boards, outputs, writes, .. } = &mut self.wiring;
        for ((to, volts), output) in given.iter_mut().zip(volts).zip(outputs) {
            let (code, given) = output.code(if finite { volts } else { 0.0 });
            writes.set(output.place, code);
            *to = given;
        }
        let card = boards.first().ok_or(DaqError::Link("no device"))?;
        writes.run(&card.device).map_err(|_| DaqError::Link("writing volts"))?;
        if given != self.written.volts {
            self.written_before = self.written;
            self.written = Written { volts: given, since_ns: now_ns() };
        }
        if finite { Ok(()) } else { Err(DaqError::NotFinite) }
    }

    fn write_digital(&mut self, levels: u32) -> Result<(), DaqError> {
        let Wiring { boards, digital, .. } = &self.wiring;
        if levels.checked_shr(digital.outputs()).unwrap_or_default() != 0 {
            return Err(DaqError::NoOutput);
        }
        if self.digital_out != Some(levels) {
            digital.set(boards, levels).map_err(|_| DaqError::Link("setting digital outputs"))?;
            self.digital_out = Some(levels);
        }
        Ok(())
    }

    fn scans_missed(&self) -> u64 {
        self.missed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_restarts_a_second_and_no_more() {
        let mut restarts = Restarts::default();
        let times = [5.0, 5.1, 5.2, 5.3, 6.2, 7.3, 8.4];
        let allowed = times.map(|time| restarts.allow((time * 1e9) as u64));
        assert_eq!(allowed, [true, true, true, false, true, true, true]);
    }
}

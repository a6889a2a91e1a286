//! Outlets of Lab Streaming Layer: one stream for each topic, and one of markers.
//!
//! The rig's topics are read every 10 ms; each sample has the time of its scan, converted to the
//! clock of Lab Streaming Layer. liblsl sends in threads of its own, and drops what a receiver does
//! not take for a minute.

mod clock_offset;
#[allow(unsafe_code)]
mod liblsl;
mod streams;

use std::io::Write;

use ipc_types::{Event, Message as _, Topic};
use probe::channel::Reader;
use probe::{Arrived, Attached, Progress, Source as _};
use runtime::RigName;
use runtime::clock::now_ns;
use web_console::computer_name;

use crate::PERIOD_NS;
use crate::args::LslArgs;
use clock_offset::ClockOffset;
use liblsl::{Liblsl, Outlet};
use streams::Named;

pub(crate) fn run(args: &LslArgs, rig_name: &RigName, out: &mut dyn Write) -> anyhow::Result<i32> {
    let topics = streams::numeric_topics(&args.topics)?;
    let lsl = Liblsl::load(args.library.as_deref())?;
    let rig = operator::rig_of(rig_name)?;
    let all: Vec<&'static Topic> = topics.iter().copied().chain(streams::event_topics()).collect();
    let mut source = Attached::new(rig_name, &all, PERIOD_NS)?;
    let measure = || ClockOffset::measure(now_ns, || lsl.local_clock_s());
    let clock = measure();
    let computer = computer_name();
    let named = Named { rig_name: rig_name.as_str(), rig: &rig, computer: &computer, clock };
    let mut outlets = Outlets::new(&lsl, &named, &topics, &source, out)?;
    out.flush()?;
    say!("liblsl {}; its clock less CLOCK_MONOTONIC is {clock}", lsl.version());
    let ended = outlets.run(&mut source);
    outlets.tell_end();
    let now = measure();
    if !clock.agrees(&now) {
        say!("the clocks have drifted: at the end the offset was {now}");
    }
    ended.map(|()| recorder::DONE)
}

/// A stream of numbers.
struct Numbers {
    topic: &'static str,
    outlet: Outlet,
    reader: Reader,
    /// Samples that came since they were sent last: their values, and their times (s).
    values: Vec<f64>,
    times_s: Vec<f64>,
    /// Values of one sample.
    row: Vec<f64>,
    sent: u64,
    lost: u64,
}

/// All streams.
struct Outlets {
    /// Names of the topics, by index.
    names: Vec<String>,
    /// The first topics; what comes behind them are events.
    numbers: Vec<Numbers>,
    markers: Outlet,
    /// Markers that came since they were sent last, with their times (s).
    told: Vec<(String, f64)>,
    markers_sent: u64,
    events_lost: u64,
    clock: ClockOffset,
    since_ns: u64,
}

impl Outlets {
    /// Makes the streams visible, and prints what they are.
    fn new(
        lsl: &Liblsl,
        named: &Named<'_>,
        topics: &[&'static Topic],
        source: &Attached,
        out: &mut dyn Write,
    ) -> anyhow::Result<Self> {
        let mut numbers = Vec::with_capacity(topics.len());
        for (topic, (info, reader)) in topics.iter().zip(named.numeric(topics, source.streams())?) {
            let outlet = lsl.outlet(&info)?;
            writeln!(out, "{}: {} channels, {} Hz", info.name, info.channels.len(), info.rate_hz)?;
            numbers.push(Numbers {
                topic: topic.name,
                outlet,
                reader,
                values: Vec::new(),
                times_s: Vec::new(),
                row: Vec::new(),
                sent: 0,
                lost: 0,
            });
        }
        let info = named.markers();
        let markers = lsl.outlet(&info)?;
        writeln!(out, "{}: markers", info.name)?;
        Ok(Self {
            names: source.streams().iter().map(|stream| stream.name.clone()).collect(),
            numbers,
            markers,
            told: Vec::new(),
            markers_sent: 0,
            events_lost: 0,
            clock: named.clock,
            since_ns: source.since_ns(),
        })
    }

    fn run(&mut self, source: &mut Attached) -> anyhow::Result<()> {
        while source.read(u64::MAX, &mut |message| self.take(message))? != Progress::Ended {
            self.send()?;
        }
        self.send()
    }

    fn take(&mut self, message: &Arrived<'_>) {
        // A receiver that starts to record wants nothing from before.
        if message.sent.time_ns < self.since_ns {
            return;
        }
        let missing = message.sent.gap.unwrap_or(0);
        if missing > 0 {
            let name = self.names.get(message.stream).map_or("", String::as_str);
            let at_s = self.clock.by_other_s(message.sent.time_ns);
            self.told.push((format!("bridge: {missing} messages of {name} lost"), at_s));
        }
        if let Some(stream) = self.numbers.get_mut(message.stream) {
            stream.lost += missing;
            stream.times_s.push(self.clock.by_other_s(stream.reader.time_ns(message)));
            stream.reader.read(message.bytes, &mut stream.row);
            stream.values.append(&mut stream.row);
        } else if let Some(event) = Event::from_bytes(message.bytes) {
            self.events_lost += missing;
            self.told.push((streams::marker(&event), self.clock.by_other_s(event.time_ns)));
        }
    }

    fn send(&mut self) -> anyhow::Result<()> {
        for stream in &mut self.numbers {
            stream.outlet.push(&stream.values, &stream.times_s)?;
            stream.sent += stream.times_s.len() as u64;
            stream.values.clear();
            stream.times_s.clear();
        }
        for (marker, at_s) in self.told.drain(..) {
            self.markers.push_text(&marker, at_s)?;
            self.markers_sent += 1;
        }
        Ok(())
    }

    /// Says on standard error what became of the messages.
    fn tell_end(&self) {
        for Numbers { topic, sent, lost, .. } in &self.numbers {
            say!("{topic}: {sent} samples sent, {lost} lost before the bridge");
        }
        say!("{} markers sent, {} events lost", self.markers_sent, self.events_lost);
    }
}

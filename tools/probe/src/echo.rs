//! `echo`.

use std::io::{BufWriter, Write};

use anyhow::bail;
use runtime::RigName;
use runtime::clock::MILLISECOND_NS;
use serde_json::json;

use crate::args::{EchoArgs, Format};
use crate::attach;
use crate::fields::Picks;
use crate::source;
use crate::stream::{Arrived, Progress, Source, Stamp, Stream};
use crate::thinning::Thinning;

/// Polling period; the subscribers' buffers hold at least 100 ms (ns).
const PERIOD_NS: u64 = 10 * MILLISECOND_NS;
/// Longest history that is printed (the newest events, the last timing); that of the card's FIFO is
/// longer.
const SHORT_HISTORY: usize = 16;

pub(crate) fn echo(args: &EchoArgs, rig: &RigName, out: &mut dyn Write) -> anyhow::Result<i32> {
    if args.file.is_none() {
        // What is wrong with a field is told before a rig is looked for.
        Picks::new(&Stream::of_topic(attach::topic(&args.topic)?), &args.fields)?;
    }
    let topics = [args.topic.clone()];
    source::observe(args.file.as_deref(), rig, &topics, PERIOD_NS, |source| {
        follow(args, source, out)
    })
}

fn follow(args: &EchoArgs, source: &mut dyn Source, out: &mut dyn Write) -> anyhow::Result<i32> {
    let streams = source.streams();
    let picks =
        streams.iter().map(|stream| Picks::new(stream, &args.fields)).collect::<Result<_, _>>()?;
    let short = streams.iter().all(|stream| stream.history <= SHORT_HISTORY);
    let since_ns = if short { 0 } else { source.since_ns() };
    let mut printer = Printer::new(args, picks, out);
    let mut thinning = Thinning::new(args.every.map_or(0, attach::ns));
    let mut left = args.count().unwrap_or(u64::MAX);
    let mut ended = false;
    while left > 0 && !ended {
        let mut result = Ok(());
        let progress = source.read(u64::MAX, &mut |message| {
            let wanted = left > 0 && result.is_ok() && message.sent.time_ns >= since_ns;
            if wanted && thinning.takes(message.sent.time_ns) {
                left -= 1;
                result = printer.print(message);
            }
        })?;
        result?;
        // On a running rig what has come is shown at once.
        if args.file.is_none() {
            printer.flush()?;
        }
        ended = progress == Progress::Ended;
    }
    printer.flush()?;
    tell(args, thinning.skipped(), source.streams().iter().map(Stream::lost).sum());
    Ok(source.exit_code())
}

/// Says on standard error which messages were not printed, and why.
fn tell(args: &EchoArgs, skipped: u64, lost: u64) {
    let topic = &args.topic;
    if skipped > 0 {
        eprintln!("{skipped} messages of {topic} were skipped by --every; they were not lost");
    }
    match &args.file {
        _ if lost == 0 => {}
        Some(file) => eprintln!("{lost} messages of {topic} are missing in {}", file.display()),
        None => eprintln!(
            "{lost} messages of {topic} are not shown: they arrived faster than they were printed"
        ),
    }
}

/// Prints messages of one topic.
struct Printer<'a> {
    topic: &'a str,
    /// by stream: a recording that was merged may have a topic with several layouts
    picks: Vec<Picks>,
    out: Out<'a>,
}

/// Where and how messages are printed.
enum Out<'a> {
    Text(BufWriter<&'a mut dyn Write>),
    Json(BufWriter<&'a mut dyn Write>),
    /// With its header, once that is printed.
    Csv(Box<csv::Writer<&'a mut dyn Write>>, Option<Vec<String>>),
}

impl<'a> Printer<'a> {
    fn new(args: &'a EchoArgs, picks: Vec<Picks>, out: &'a mut dyn Write) -> Self {
        let out = match args.format() {
            Format::Text => Out::Text(BufWriter::new(out)),
            Format::Json => Out::Json(BufWriter::new(out)),
            Format::Csv => Out::Csv(Box::new(csv::Writer::from_writer(out)), None),
        };
        Self { topic: &args.topic, picks, out }
    }

    fn print(&mut self, message: &Arrived<'_>) -> anyhow::Result<()> {
        let Some(picks) = self.picks.get(message.stream) else { return Ok(()) };
        let (clock, at_ns) = match message.stamp {
            Stamp::Received(at_ns) => ("received_ns", at_ns),
            Stamp::Logged(at_ns) => ("log_time_ns", at_ns),
        };
        match &mut self.out {
            Out::Text(out) => writeln!(out, "{}", picks.line(message.bytes))?,
            Out::Json(out) => {
                let fields = picks.json(message.bytes);
                let object = json!({"topic": self.topic, clock: at_ns, "fields": fields});
                writeln!(out, "{object}")?;
            }
            Out::Csv(table, header) => {
                let mut columns = vec![clock.to_owned()];
                columns.extend(picks.header());
                if header.as_ref().is_some_and(|header| *header != columns) {
                    bail!(
                        "topic {} changes its fields within the recording: choose, by --field, \
                         those that all of its parts have",
                        self.topic
                    );
                }
                if header.is_none() {
                    table.write_record(&columns)?;
                    *header = Some(columns);
                }
                let time = std::iter::once(at_ns.to_string());
                table.write_record(time.chain(picks.row(message.bytes)))?;
            }
        }
        Ok(())
    }

    fn flush(&mut self) -> anyhow::Result<()> {
        match &mut self.out {
            Out::Text(out) | Out::Json(out) => out.flush()?,
            Out::Csv(table, _) => table.flush()?,
        }
        Ok(())
    }
}

//! Foxglove and Lichtblick attach live.
//!
//! One thread reads the rig's topics, every 10 ms, and puts them in front of the viewers without
//! ever waiting; another one serves the viewers.

mod origin;
pub(crate) mod protocol;
mod server;
mod viewer;

use std::collections::VecDeque;
use std::io::Write;
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::thread::JoinHandle;

use anyhow::{Context as _, bail};
use ipc_types::{Rate, Topic};
use probe::{Arrived, Attached, Progress, Source as _, Thinning};
use recording::channel;
use runtime::clock::{ClockPair, SECOND_NS};
use runtime::{RigName, random_u64};

use crate::PERIOD_NS;
use crate::args::FoxgloveArgs;
use server::Site;
use viewer::Outgoing;

/// How often viewers are told what they did not get (ns).
const TELL_NS: u64 = SECOND_NS;
/// Longest history that a viewer gets (the newest events, the last timing); that of the card's FIFO
/// is longer.
const SHORT_HISTORY: usize = 16;

pub(crate) fn run(args: &FoxgloveArgs, rig: &RigName, out: &mut dyn Write) -> anyhow::Result<i32> {
    let topics = probe::topics(&args.topics)?;
    let mut source = Attached::new(rig, &topics, PERIOD_NS)?;
    let address = SocketAddr::new(args.host, args.port);
    let listener = TcpListener::bind(address).with_context(|| {
        format!("cannot listen at {address}; choose another address by --host and --port")
    })?;
    let address = listener.local_addr()?;
    let welcome = [protocol::server_info(rig.as_str(), random_u64()), protocol::advertise(&topics)];
    let site = Arc::new(Site::new(&args.origins, welcome, topics.len()));
    let server = server::start(Arc::clone(&site), listener)?;
    if !args.host.is_loopback() {
        say!("whoever reaches {address} can read what is measured; there is no encryption");
    }
    writeln!(out, "ws://{address}")?;
    out.flush()?;
    let period_ns = args.every.map_or(0, probe::ns);
    let mut forwarder = Forwarder::new(&topics, period_ns, site);
    let ended = forwarder.run(&mut source, &server);
    forwarder.tell_end(&source);
    ended.map(|()| recorder::DONE)
}

/// One topic.
struct Feed {
    topic: &'static Topic,
    thinning: Thinning,
    /// What a viewer gets first: the newest messages, of topics that have a history.
    history: VecDeque<Outgoing>,
}

/// Hands messages on.
struct Forwarder {
    feeds: Vec<Feed>,
    realtime_offset_ns: i64,
    site: Arc<Site>,
}

impl Forwarder {
    fn new(topics: &[&'static Topic], period_ns: u64, site: Arc<Site>) -> Self {
        let feed = |topic: &&'static Topic| {
            // What happens once is not skipped.
            let period_ns = if topic.rate == Rate::Sporadic { 0 } else { period_ns };
            Feed { topic, thinning: Thinning::new(period_ns), history: VecDeque::new() }
        };
        Self {
            feeds: topics.iter().map(feed).collect(),
            realtime_offset_ns: ClockPair::measure().offset_ns(),
            site,
        }
    }

    fn run(&mut self, source: &mut Attached, server: &JoinHandle<()>) -> anyhow::Result<()> {
        let mut tell_ns = 0;
        loop {
            let Progress::UpTo(now_ns) =
                source.read(u64::MAX, &mut |message| self.take(message))?
            else {
                return Ok(());
            };
            if server.is_finished() {
                bail!("the web server ended");
            }
            self.site.each(|viewer| {
                for (index, feed) in self.feeds.iter().enumerate() {
                    viewer.greet(index, feed.history.iter());
                }
            });
            if now_ns >= tell_ns {
                tell_ns = now_ns + TELL_NS;
                let name = |index: usize| self.feeds.get(index).map_or("", |feed| feed.topic.name);
                self.site.each(|viewer| viewer.tell_losses(name));
            }
        }
    }

    fn take(&mut self, message: &Arrived<'_>) {
        let index = message.stream;
        let Some(feed) = self.feeds.get_mut(index) else { return };
        let missing = message.sent.gap.unwrap_or(0);
        if !feed.thinning.takes(message.sent.time_ns) {
            if missing > 0 {
                self.site.each(|viewer| viewer.lost(index, missing));
            }
            return;
        }
        let wall_time_ns = channel::wall_time_ns(message.sent.time_ns, self.realtime_offset_ns);
        let mut payload = Vec::with_capacity(message.bytes.len() + ipc_types::CDR_HEADER.len());
        channel::put_payload(message.bytes, &mut payload);
        let outgoing = Outgoing { wall_time_ns, payload };
        self.site.each(|viewer| viewer.offer(index, feed.history.iter(), &outgoing, missing));
        let kept = feed.topic.history;
        if (1..=SHORT_HISTORY).contains(&kept) {
            while feed.history.len() >= kept {
                feed.history.pop_front();
            }
            feed.history.push_back(outgoing);
        }
    }

    /// Says on standard error what became of the messages.
    fn tell_end(&self, source: &Attached) {
        self.site.each(|viewer| {
            say!("viewer {} ({}) to the end: {}", viewer.number, viewer.from, viewer.counts());
        });
        for (feed, stream) in self.feeds.iter().zip(source.streams()) {
            let (name, skipped, lost) = (feed.topic.name, feed.thinning.skipped(), stream.lost());
            if skipped > 0 {
                say!("{skipped} messages of {name} were skipped by --every; they were not lost");
            }
            if lost > 0 {
                say!("{lost} messages of {name} were lost before the bridge: it was late");
            }
        }
    }
}

//! `echo`.

use std::io::Write;

use runtime::RigName;
use runtime::clock::MILLISECOND_NS;
use serde_json::json;

use crate::args::EchoArgs;
use crate::attach::{self, Attached};
use crate::fields;

/// Polling period; the subscribers' buffers hold at least 100 ms (ns).
const PERIOD_NS: u64 = 10 * MILLISECOND_NS;
/// Longest history that is printed (the newest events, the last timing); that of the card's FIFO is
/// longer.
const SHORT_HISTORY: usize = 16;

pub(crate) fn echo(args: &EchoArgs, rig: &RigName, out: &mut dyn Write) -> anyhow::Result<()> {
    let topic = attach::topic(&args.topic)?;
    let picks = fields::picks(topic, &args.fields)?;
    let mut rig = Attached::new(rig, &[topic], PERIOD_NS)?;
    let since_ns = if topic.history <= SHORT_HISTORY { 0 } else { rig.since_ns };
    let mut left = args.count.unwrap_or(u64::MAX);
    let mut result = Ok(());
    while left > 0 && !rig.stopping() {
        rig.wait(u64::MAX)?;
        rig.drain(|_, bytes, received_ns| {
            if left == 0 || result.is_err() || time_of(bytes) < since_ns {
                return;
            }
            left -= 1;
            result = if args.json {
                let fields = fields::json(topic, &picks, bytes);
                let object =
                    json!({"topic": topic.name, "received_ns": received_ns, "fields": fields});
                writeln!(out, "{object}")
            } else {
                writeln!(out, "{}", fields::line(topic, &picks, bytes))
            };
        })?;
        std::mem::replace(&mut result, Ok(()))?;
        out.flush()?;
    }
    let lost: u64 = rig.feeds.iter().map(|feed| feed.subscriber.counters().lost).sum();
    if lost > 0 {
        eprintln!(
            "{lost} messages of {} are not shown: they arrived faster than they were printed",
            topic.name
        );
    }
    Ok(())
}

/// When a message was published (ns, CLOCK_MONOTONIC): its fourth 64-bit word.
pub(crate) fn time_of(bytes: &[u8]) -> u64 {
    word(bytes, 24)
}

/// The 64-bit word at this offset of a message.
pub(crate) fn word(bytes: &[u8], at: usize) -> u64 {
    let mut raw = [0; 8];
    if let Some(slice) = bytes.get(at..at + 8) {
        raw.copy_from_slice(slice);
    }
    u64::from_le_bytes(raw)
}

//! `info` and `verify`.

use std::io::Write;
use std::path::Path;

use recording::mcap_read::{Check, Recording};
use recording::mcap_write::key;
use serde_json::{Value, json};

use crate::{DATA_LOST, DONE};

/// A number with thousands set apart.
pub(crate) fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

pub(crate) fn info(file: &Path, json: bool, out: &mut dyn Write) -> anyhow::Result<i32> {
    let recording = Recording::open(file)?;
    let check = recording.check()?;
    if json {
        writeln!(out, "{}", as_json(&recording, &check))?;
        return Ok(DONE);
    }
    let name = file.display();
    writeln!(
        out,
        "{name}: {} bytes, {} chunks, written by {}",
        grouped(recording.bytes()),
        recording.blocks(),
        if recording.library().is_empty() { "an unknown program" } else { recording.library() }
    )?;
    let about: Vec<String> = [key::RIG, key::PROTOCOL, key::PROFILE, key::PART, key::REVISION]
        .into_iter()
        .filter_map(|key| recording.metadata(key).map(|value| format!("{key} {value}")))
        .collect();
    if !about.is_empty() {
        writeln!(out, "  {}", about.join(", "))?;
    }
    if check.complete && check.ended_cleanly {
        writeln!(out, "  ended in good order")?;
    } else {
        losses(&recording, &check, out)?;
    }
    let origin = check.span_ns().map_or(0, |span| span.0);
    writeln!(
        out,
        "  {:<18} {:>8} {:>14} {:>10} {:>10}",
        "topic", "count", "rate Hz", "first s", "last s"
    )?;
    for topic in check.topics.iter().filter(|topic| topic.count > 0) {
        let seconds = |time: u64| (time - origin) as f64 * 1e-9;
        let rate = topic.rate_hz().map_or_else(|| "-".to_owned(), |rate| format!("{rate:.1}"));
        writeln!(
            out,
            "  {:<18} {:>8} {:>14} {:>10.3} {:>10.3}",
            topic.topic,
            topic.count,
            rate,
            seconds(topic.first_ns),
            seconds(topic.last_ns)
        )?;
    }
    Ok(DONE)
}

pub(crate) fn verify(file: &Path, json: bool, out: &mut dyn Write) -> anyhow::Result<i32> {
    let recording = Recording::open(file)?;
    let check = recording.check()?;
    let lost = check.data_lost();
    if json {
        writeln!(out, "{}", as_json(&recording, &check))?;
        return Ok(if lost { DATA_LOST } else { DONE });
    }
    if lost {
        writeln!(out, "{}: DATA LOST", file.display())?;
        losses(&recording, &check, out)?;
    } else {
        writeln!(
            out,
            "{}: nothing lost: {} messages, {} topics with data, every checksum right",
            file.display(),
            grouped(check.messages()),
            check.topics.iter().filter(|topic| topic.count > 0).count()
        )?;
    }
    for topic in &check.topics {
        let mut faults = Vec::new();
        if topic.gaps > 0 {
            faults.push(format!(
                "{} missing in {} places",
                grouped(topic.gaps),
                grouped(topic.gap_places)
            ));
        }
        if topic.dropped > 0 {
            faults.push(format!("{} dropped or refused by the logger", grouped(topic.dropped)));
        }
        if topic.duplicates > 0 {
            faults.push(format!("{} repeated or out of order", grouped(topic.duplicates)));
        }
        if topic.undecodable > 0 {
            faults.push(format!(
                "{} cannot be decoded ({})",
                grouped(topic.undecodable),
                topic.problem
            ));
        }
        if !faults.is_empty() {
            writeln!(
                out,
                "  {}: {} messages; {}",
                topic.topic,
                grouped(topic.count),
                faults.join("; ")
            )?;
        }
    }
    if let Some(ticks) = check.ticks {
        let missing = match (ticks.missing, ticks.holes) {
            (0, _) => "none missing".to_owned(),
            (missing, holes) => {
                format!("{} missing in {} places", grouped(missing), grouped(holes))
            }
        };
        let backwards = match ticks.backwards {
            0 => String::new(),
            many => format!(", {} not ascending", grouped(many)),
        };
        writeln!(out, "  sample: ticks {} to {}, {missing}{backwards}", ticks.first, ticks.last)?;
    }
    Ok(if lost { DATA_LOST } else { DONE })
}

fn losses(recording: &Recording, check: &Check, out: &mut dyn Write) -> std::io::Result<()> {
    let tail = recording.tail();
    if !tail.complete {
        writeln!(out, "  {} ({} bytes unreadable)", tail.reason, grouped(tail.lost))?;
    } else if !check.ended_cleanly {
        writeln!(
            out,
            "  the recording was not ended in good order: it was cut off and mended, or its logger failed"
        )?;
    }
    for damage in &check.damage {
        writeln!(out, "  damaged at byte {}: {}", grouped(damage.offset), damage.what)?;
    }
    Ok(())
}

fn as_json(recording: &Recording, check: &Check) -> Value {
    let topics: Vec<Value> = check
        .topics
        .iter()
        .map(|t| {
            json!({
                "topic": t.topic, "type": t.schema_name, "count": t.count, "first_ns": t.first_ns, "last_ns": t.last_ns,
                "rate_hz": t.rate_hz(), "gaps": t.gaps, "gap_places": t.gap_places, "duplicates": t.duplicates,
                "incarnations": t.incarnations, "dropped": t.dropped, "undecodable": t.undecodable, "problem": t.problem,
            })
        })
        .collect();
    let damage: Vec<Value> =
        check.damage.iter().map(|d| json!({"offset": d.offset, "what": d.what})).collect();
    let ticks = check.ticks.map(
        |t| json!({"first": t.first, "last": t.last, "missing": t.missing, "holes": t.holes, "backwards": t.backwards}),
    );
    json!({
        "file": recording.path().to_string_lossy(),
        "bytes": recording.bytes(),
        "chunks": recording.blocks(),
        "library": recording.library(),
        "data_lost": check.data_lost(),
        "complete": check.complete,
        "ended_cleanly": check.ended_cleanly,
        "tail": {"lost_bytes": recording.tail().lost, "reason": recording.tail().reason},
        "damage": damage,
        "ticks": ticks,
        "topics": topics,
        "metadata": recording.metadata_records().iter().map(|(name, map)| json!({"name": name, "values": map})).collect::<Vec<_>>(),
    })
}

#[cfg(test)]
mod tests {
    #[test]
    fn thousands_are_set_apart() {
        for (number, text) in [(0, "0"), (999, "999"), (1000, "1,000"), (1234567, "1,234,567")] {
            assert_eq!(super::grouped(number), text);
        }
    }
}

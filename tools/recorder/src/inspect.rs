//! `info` and `verify`.

use std::collections::BTreeSet;
use std::io::Write;
use std::path::Path;
use std::time::{Duration, UNIX_EPOCH};

use anyhow::bail;
use ipc_types::{ANALOG, AXES};
use recording::mcap_read::{Check, Contents, Damage, Recording, Selection, TopicContents};
use recording::mcap_write::{DAMAGED_RECORD, key};
use serde_json::{Value, json};

use crate::monitored::Monitored;
use crate::notes::{Note, notes};
use crate::progress::Progress;
use crate::replacements::Replacements;
use crate::{DATA_LOST, DONE};

/// Prints one entry of the metadata: of the recording, or of a protocol that was played.
pub(crate) fn text(file: &Path, key: &str, out: &mut dyn Write) -> anyhow::Result<i32> {
    let recording = Recording::open_damaged(file)?;
    let records = || recording.metadata_records.iter();
    let sound = records().filter(|(name, _)| name != DAMAGED_RECORD);
    let damaged = records().filter(|(name, _)| name == DAMAGED_RECORD);
    let found = sound.chain(damaged).find_map(|(name, entries)| Some((name, entries.get(key)?)));
    let Some((name, text)) = found else {
        let keys: BTreeSet<&str> =
            records().flat_map(|(_, entries)| entries).map(|(key, _)| key.as_str()).collect();
        let keys = Vec::from_iter(keys);
        bail!("{}: no metadata `{key}`; it has {}", file.display(), keys.join(", "));
    };
    write!(out, "{text}{}", if text.ends_with('\n') { "" } else { "\n" })?;
    if name == DAMAGED_RECORD {
        let file = file.display();
        eprintln!(
            "{file}: DAMAGED: the checksum of the record with `{key}` is wrong; read it, but \
                   do not use it as it is"
        );
        return Ok(DATA_LOST);
    }
    Ok(DONE)
}

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
    let recording = Recording::open_damaged(file)?;
    // What a whole file says of itself at its end; one that is torn or damaged is read.
    let (contents, check) = match recording.contents()? {
        Some(contents) => (contents, None),
        None => {
            let check = recording.check()?;
            (check.contents(), Some(check))
        }
    };
    let monitored = Monitored::read(&recording)?;
    let replacements = Replacements::read(&recording)?;
    let notes = notes(&recording)?;
    if json {
        let mut value = as_json(&recording, &contents, check.as_ref());
        value["model"] = json!(monitored);
        value["replaced"] = json!(replacements.processes);
        value["replaced_not_known"] = json!(replacements.not_known);
        value["notes"] = json!(notes);
        writeln!(out, "{value}")?;
        return Ok(DONE);
    }
    let name = file.display();
    writeln!(
        out,
        "{name}: {} bytes, {} chunks, written by {}",
        grouped(recording.bytes),
        recording.blocks(),
        if recording.library.is_empty() { "an unknown program" } else { &recording.library }
    )?;
    if let (Some(origin), Some((_, last))) = (contents.origin_ns, contents.span_ns()) {
        let began = humantime::format_rfc3339_seconds(UNIX_EPOCH + Duration::from_nanos(origin));
        writeln!(out, "  from {began}, {:.3} s", last.saturating_sub(origin) as f64 * 1e-9)?;
    }
    about(&recording, out)?;
    for line in replacements.lines().into_iter().chain(notes.iter().map(Note::line)) {
        writeln!(out, "  {line}")?;
    }
    if !recording.start_is_guarded() {
        writeln!(
            out,
            "  rig file without a checksum of its own (an older build): `rec verify` alone notices \
             a bit of it that has changed"
        )?;
    }
    let damage = check.as_ref().map_or(&recording.damage, |check| &check.damage);
    if recording.tail.complete && recording.ended_as_expected() && damage.is_empty() {
        writeln!(out, "  ended cleanly")?;
    } else {
        losses(&recording, damage, out)?;
    }
    table(&contents, out)?;
    of_the_model(&monitored, out)?;
    Ok(DONE)
}

/// The topics that have messages.
fn table(contents: &Contents, out: &mut dyn Write) -> std::io::Result<()> {
    writeln!(
        out,
        "  {:<18} {:>8} {:>14} {:>10} {:>10}",
        "topic", "count", "rate Hz", "first s", "last s"
    )?;
    let origin = contents.origin_ns.unwrap_or(0);
    for topic in contents.topics.iter().filter(|topic| topic.count > 0) {
        // negative for events before the recording
        let seconds = |time: u64| (time as i128 - i128::from(origin)) as f64 * 1e-9;
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
    Ok(())
}

/// What the monitor said; nothing where none ran.
fn of_the_model(monitored: &Monitored, out: &mut dyn Write) -> std::io::Result<()> {
    if monitored.events.is_empty() && monitored.last.is_empty() {
        return Ok(());
    }
    writeln!(out, "  the model beside the machine (farreach rec innovations):")?;
    for event in &monitored.events {
        writeln!(out, "  {}", event.line())?;
    }
    for sentence in &monitored.last {
        writeln!(out, "    at the end: {sentence}")?;
    }
    Ok(())
}

/// What the recording says about itself.
fn about(recording: &Recording, out: &mut dyn Write) -> std::io::Result<()> {
    let line = |out: &mut dyn Write, entries: Vec<String>| match entries.is_empty() {
        true => Ok(()),
        false => writeln!(out, "  {}", entries.join(", ")),
    };
    use key::{HOST_STALL, PART, PROFILE, PROTOCOL, REVISION, RIG, RIG_NAME, RING, SUBJECT};
    let keys = [RIG, RIG_NAME, SUBJECT, PROTOCOL, PROFILE, HOST_STALL, RING, PART, REVISION];
    let entry = |key: &str| Some(format!("{} {}", key.replace('_', " "), recording.metadata(key)?));
    line(out, keys.into_iter().filter_map(entry).collect())?;
    line(out, [key::PLACEMENT].into_iter().filter_map(entry).collect())?;
    line(out, [key::DOCTOR].into_iter().filter_map(entry).collect())?;
    for run in recording.runs() {
        let of = |key: &str| run.get(key).map(String::as_str);
        let subject = of(key::SUBJECT).map(|subject| format!("subject {subject}"));
        let protocol = of(key::PROTOCOL).map(|protocol| format!("run {protocol}"));
        line(out, protocol.into_iter().chain(subject).collect())?;
    }
    let signal = |kind: &str, index: usize| {
        let name = recording.metadata(&format!("{kind}.{index}.name"))?;
        let unit = recording.metadata(&format!("{kind}.{index}.unit"))?;
        Some(format!("{kind} {index} {name} ({unit})"))
    };
    let axes = (0..AXES).filter_map(|index| signal("axis", index));
    line(out, axes.chain((0..ANALOG).filter_map(|index| signal("analog", index))).collect())
}

pub(crate) fn verify(file: &Path, json: bool, out: &mut dyn Write) -> anyhow::Result<i32> {
    let recording = Recording::open_damaged(file)?;
    let progress = Progress::of([&recording], &Selection::default(), 1, json);
    let check = recording.check()?;
    drop(progress);
    let lost = check.data_lost();
    if json {
        writeln!(out, "{}", as_json(&recording, &check.contents(), Some(&check)))?;
        return Ok(if lost { DATA_LOST } else { DONE });
    }
    if lost {
        writeln!(out, "{}: DATA LOST", file.display())?;
        losses(&recording, &check.damage, out)?;
    } else {
        writeln!(
            out,
            "{}: {}nothing lost: {} messages, {} topics with data, every checksum right",
            file.display(),
            if recording.tail.being_written { "still being written; so far " } else { "" },
            grouped(check.messages()),
            check.topics.iter().filter(|topic| topic.count > 0).count()
        )?;
    }
    for topic in &check.topics {
        let before = match topic.gaps_before {
            0 => String::new(),
            gaps => format!(", {} of them since the part before", grouped(gaps)),
        };
        let faults: Vec<String> = [
            (topic.gaps, format!("missing {}{before}", places(topic.gap_places))),
            (topic.dropped, "dropped or refused by the logger".to_owned()),
            (topic.duplicates, "repeated or out of order".to_owned()),
            (topic.undecodable, format!("cannot be decoded ({})", topic.problem)),
        ]
        .into_iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, what)| format!("{} {what}", grouped(count)))
        .collect();
        if !faults.is_empty() {
            let (count, faults) = (grouped(topic.count), faults.join("; "));
            writeln!(out, "  {}: {count} messages; {faults}", topic.topic)?;
        }
    }
    if let Some(ticks) = check.ticks {
        let missing = match ticks.missing {
            0 => "none missing".to_owned(),
            missing => format!("{} missing {}", grouped(missing), places(ticks.holes)),
        };
        let backwards = match ticks.backwards {
            0 => String::new(),
            many => format!(", {} not ascending", grouped(many)),
        };
        let filled_in = filled_in(&check);
        writeln!(
            out,
            "  sample: ticks {} to {}, {missing}{backwards}{filled_in}",
            ticks.first, ticks.last
        )?;
    }
    Ok(if lost { DATA_LOST } else { DONE })
}

/// What the simulated card took too late: such ticks are not missing, and were not in time.
fn filled_in(check: &Check) -> String {
    match check.filled_in {
        None if check.simulated => {
            ", but not whether the simulated card filled some in late (an older build)".to_owned()
        }
        None => String::new(),
        Some(found) if found.ticks == 0 => ", none filled in late".to_owned(),
        Some(found) => format!(
            ", {} filled in late by the simulated card, the longest stretch {} ticks ({:.1} ms)",
            grouped(found.ticks),
            grouped(found.longest),
            found.longest_ns as f64 * 1e-6
        ),
    }
}

fn places(number: u64) -> String {
    format!("in {} place{}", grouped(number), if number == 1 { "" } else { "s" })
}

fn losses(recording: &Recording, damage: &[Damage], out: &mut dyn Write) -> std::io::Result<()> {
    let tail = &recording.tail;
    if !tail.complete {
        let lost = match (tail.being_written, tail.lost) {
            (true, _) => String::new(),
            (false, lost) => format!(" ({} bytes unreadable)", grouped(lost)),
        };
        writeln!(out, "  {}{lost}", tail.reason)?;
    } else if !recording.ended_as_expected() {
        writeln!(
            out,
            "  the recording did not end cleanly: it was cut off and recovered, or its logger \
                failed"
        )?;
    }
    for damage in damage {
        writeln!(out, "  damaged at byte {}: {}", grouped(damage.offset), damage.what)?;
    }
    Ok(())
}

/// What only reading the whole file tells, of a topic.
const OF_A_CHECK: [&str; 7] =
    ["gaps", "gap_places", "duplicates", "incarnations", "undecodable", "problem", "gaps_before"];

/// What is known of a recording; `null` for what only a check tells, where there was none.
fn as_json(recording: &Recording, contents: &Contents, check: Option<&Check>) -> Value {
    let mut topics: Vec<Value> = match check {
        Some(check) => check.topics.iter().map(|topic| json!(topic)).collect(),
        None => contents.topics.iter().map(|topic| unchecked(recording, topic)).collect(),
    };
    for (value, topic) in topics.iter_mut().zip(&contents.topics) {
        value["rate_hz"] = json!(topic.rate_hz());
    }
    let damage = check.map_or(&recording.damage, |check| &check.damage);
    let (complete, ended_cleanly) = (recording.tail.complete, recording.ended_as_expected());
    let data_lost = match check {
        Some(check) => Some(check.data_lost()),
        None => {
            let dropped = contents.topics.iter().any(|topic| recording.dropped(&topic.topic) > 0);
            (dropped || !ended_cleanly || !damage.is_empty()).then_some(true)
        }
    };
    let metadata: Vec<Value> = recording
        .metadata_records
        .iter()
        .map(|(name, map)| json!({"name": name, "values": map}))
        .collect();
    json!({
        "file": recording.path().to_string_lossy(),
        "bytes": recording.bytes,
        "chunks": recording.blocks(),
        "library": recording.library,
        "start_is_guarded": recording.start_is_guarded(),
        "verified": check.is_some(),
        "data_lost": data_lost,
        "complete": complete,
        "ended_cleanly": ended_cleanly,
        "tail": {"lost_bytes": recording.tail.lost, "reason": recording.tail.reason},
        "damage": damage,
        "ticks": check.and_then(|check| check.ticks),
        "simulated_card": check.map(|check| check.simulated),
        "filled_in": check.and_then(|check| check.filled_in),
        "topics": topics,
        "metadata": metadata,
        "began_ns": contents.origin_ns,
        "being_written": recording.tail.being_written,
    })
}

/// A topic of which only the summary told.
fn unchecked(recording: &Recording, topic: &TopicContents) -> Value {
    let mut value = json!(topic);
    value["dropped"] = json!(recording.dropped(&topic.topic));
    for key in OF_A_CHECK {
        value[key] = Value::Null;
    }
    value
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

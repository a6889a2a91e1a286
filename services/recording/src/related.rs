//! Whether recordings belong together.

use std::path::Path;

use crate::mcap_edit::{EditError, Unrelated};
use crate::mcap_read::{ReadError, Recording};
use crate::mcap_write::key;

/// What tells one rig, and one cold start of it, from another.
const IDENTITY: [(&str, &str); 3] =
    [("rig", key::RIG), ("rig name", key::RIG_NAME), ("session", key::SESSION)];
/// Difference of the clocks' offsets between parts that no correction of a clock makes (ns).
const CLOCK_STEP_NS: u64 = 10_000_000_000;
/// Time by which two parts may seem to overlap, as the clock of the day is corrected (ns).
const OVERLAP_NS: u64 = 1_000_000_000;

/// Refuses recordings of different rigs or sessions. Files that do not say (those of other
/// programs) are taken.
///
/// # Errors
/// [`EditError::Unrelated`], naming the first two files that differ.
pub fn check_related(sources: &[&Recording]) -> Result<(), EditError> {
    IDENTITY.into_iter().try_for_each(|(what, key)| {
        same(sources, what, key, |one, other| {
            (one != other).then(|| (one.to_owned(), other.to_owned()))
        })
    })
}

/// As [`check_related`], for recordings that are to become one file: refuses those with different
/// rig files too, or between which the clock of the day was set or the computer restarted, and
/// those that overlap in time and are no copies out of one recording.
///
/// # Errors
/// [`EditError::Unrelated`], [`EditError::Overlapping`], and those of reading, as a torn file is
/// read to its end.
pub fn check_one_session(sources: &[&Recording]) -> Result<(), EditError> {
    check_related(sources)?;
    same(sources, "rig file", key::RIG_FILE, first_difference)?;
    same(sources, "clock offset", key::REALTIME_OFFSET_NS, |one, other| {
        let offset = |text: &str| text.parse::<i64>().ok();
        let apart = offset(one)?.abs_diff(offset(other)?);
        (apart > CLOCK_STEP_NS).then(|| (format!("{one} ns"), format!("{other} ns")))
    })?;
    let mut spans = Vec::new();
    for source in sources {
        if source.start_record().is_some()
            && let Some((from_ns, until_ns)) = span_ns(source)?
        {
            spans.push(Span { source, from_ns, until_ns });
        }
    }
    spans.sort_by_key(|span| span.from_ns);
    for pair in spans.windows(2) {
        let [first, second] = pair else { continue };
        let copies =
            first.source.metadata(key::STARTED_NS) == second.source.metadata(key::STARTED_NS);
        if !copies && second.from_ns.saturating_add(OVERLAP_NS) < first.until_ns {
            return Err(EditError::Overlapping {
                first_path: first.path().to_owned(),
                first_s: first.seconds(),
                second_path: second.path().to_owned(),
                second_s: second.seconds(),
            });
        }
    }
    Ok(())
}

/// Compares an entry of the metadata between the first file that has it and each other one;
/// `differ` tells what was expected and found.
fn same(
    sources: &[&Recording],
    what: &'static str,
    key: &'static str,
    differ: impl Fn(&str, &str) -> Option<(String, String)>,
) -> Result<(), EditError> {
    let mut known: Option<(&Recording, &str)> = None;
    for source in sources {
        let Some(value) = source.metadata(key) else { continue };
        let Some((first, expected)) = known else {
            known = Some((source, value));
            continue;
        };
        if let Some((expected, found)) = differ(expected, value) {
            return Err(EditError::Unrelated(Box::new(Unrelated {
                what,
                key,
                first_path: first.path().to_owned(),
                first: expected,
                second_path: source.path().to_owned(),
                second: found,
            })));
        }
    }
    Ok(())
}

/// The first line in which two texts differ.
fn first_difference(one: &str, other: &str) -> Option<(String, String)> {
    if one == other {
        return None;
    }
    let (mut lines, mut others) = (one.lines(), other.lines());
    for number in 1.. {
        let (line, other) = (lines.next(), others.next());
        if line != other || line.is_none() {
            let told = |line: Option<&str>| match line {
                Some(line) => format!("line {number} `{line}`"),
                None => format!("no line {number}"),
            };
            return Some((told(line), told(other)));
        }
    }
    None
}

/// Log times of a recording's own messages (ns since 1970): those from before it do not count.
struct Span<'a> {
    source: &'a Recording,
    from_ns: u64,
    until_ns: u64,
}

impl Span<'_> {
    fn path(&self) -> &Path {
        self.source.path()
    }

    /// `1700000000.000 s to 1700000001.000 s`.
    fn seconds(&self) -> String {
        let seconds = |at_ns: u64| format!("{}.{:03}", at_ns / NS, at_ns % NS / 1_000_000);
        format!("{} to {} s", seconds(self.from_ns), seconds(self.until_ns))
    }
}

/// Nanoseconds of a second.
const NS: u64 = 1_000_000_000;

fn span_ns(source: &Recording) -> Result<Option<(u64, u64)>, ReadError> {
    let contents = source.contents_or_check()?;
    Ok(contents.origin_ns.zip(contents.span_ns().map(|(_, last)| last)))
}

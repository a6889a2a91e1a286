//! Encodes BDF+ files: signals of 24 bits with annotations, as EDF+ with wider samples.
//!
//! Own code, as the crates that write such files know 16 bits alone.

use std::io::Write;
use std::time::{Duration, UNIX_EPOCH};

use anyhow::bail;
use recording::column::{Column, Cursor};

/// Largest value of a sample; its negative is the least, so that 0 is exactly 0.
const LARGEST: i32 = 8_388_607;
/// Bytes of a sample.
const BYTES: usize = 3;
/// Characters for the limits of a signal.
const LIMIT: usize = 8;
const MONTHS: [&str; 12] =
    ["JAN", "FEB", "MAR", "APR", "MAY", "JUN", "JUL", "AUG", "SEP", "OCT", "NOV", "DEC"];

/// A signal.
pub(crate) struct BdfSignal<'a> {
    /// Name: of its characters that are ASCII, 16 are kept.
    pub(crate) label: &'a str,
    /// Unit of the values.
    pub(crate) unit: &'a str,
    /// What measures it.
    pub(crate) transducer: &'a str,
    /// Its range is ± this at least, in its unit.
    pub(crate) range: f64,
    /// The values; one that is not finite is written as 0.
    pub(crate) values: Column,
}

/// A note at an instant.
pub(crate) struct BdfAnnotation {
    /// When, since the first sample (s).
    pub(crate) onset_s: f64,
    /// How long (s); 0 for an instant.
    pub(crate) duration_s: f64,
    pub(crate) text: String,
}

/// What a file says of itself.
pub(crate) struct BdfHeader<'a> {
    /// Code of the subject.
    pub(crate) subject: &'a str,
    /// What recorded it.
    pub(crate) equipment: &'a str,
    /// When the first sample was taken (ns since 1970).
    pub(crate) began_ns: u64,
    /// Sampling rate of all signals (Hz).
    pub(crate) rate_hz: u32,
}

/// Writes a file: records of a second each, the last one filled up with zeros.
///
/// # Errors
/// Where a range cannot be written in eight characters, or as writing does.
pub(crate) fn write_bdf(
    header: &BdfHeader<'_>,
    signals: &[BdfSignal<'_>],
    annotations: &[BdfAnnotation],
    out: &mut dyn Write,
) -> anyhow::Result<()> {
    let rate = header.rate_hz as usize;
    let samples = signals.iter().map(|signal| signal.values.len()).max().unwrap_or(0);
    let records = samples.div_ceil(rate).max(1);
    // Times are counted from the header's whole second.
    let fraction_s = f64::from((header.began_ns % 1_000_000_000) as u32) * 1e-9;
    let notes = Notes::new(annotations, records, fraction_s);
    let mut limits = Vec::with_capacity(signals.len());
    for signal in signals {
        limits.push(limit(signal)?);
    }
    out.write_all(&encode_header(header, signals, &limits, records, notes.capacity))?;
    // Readers compute with the limit as it is printed.
    let steps: Vec<f64> = limits
        .iter()
        .map(|limit| Ok(f64::from(LARGEST) / limit.parse::<f64>()?))
        .collect::<anyhow::Result<_>>()?;
    let mut values: Vec<Cursor<'_>> = signals.iter().map(|signal| signal.values.cursor()).collect();
    for record in 0..records {
        for (values, steps) in values.iter_mut().zip(&steps) {
            for at in record * rate..(record + 1) * rate {
                let value = if at < values.len() { values.at(at)? } else { 0.0 };
                let value = if value.is_finite() { value } else { 0.0 };
                let step = (value * steps).round() as i32;
                let step = step.clamp(-LARGEST, LARGEST);
                out.write_all(&step.to_le_bytes()[..BYTES])?;
            }
        }
        out.write_all(&notes.of_record(record))?;
    }
    Ok(())
}

/// The annotations as text, spread over the records.
struct Notes {
    /// Annotations of each record.
    records: Vec<Vec<u8>>,
    /// Bytes that a record has for them.
    capacity: usize,
    fraction_s: f64,
}

impl Notes {
    fn new(annotations: &[BdfAnnotation], records: usize, fraction_s: f64) -> Self {
        let encode = |note: &BdfAnnotation| {
            let onset_s = note.onset_s + fraction_s;
            let duration = match note.duration_s > 0.0 {
                true => format!("\x15{:.9}", note.duration_s),
                false => String::new(),
            };
            let text = note.text.replace(|c: char| c.is_control(), " ");
            format!("{onset_s:+.9}{duration}\x14{text}\x14\0").into_bytes()
        };
        let notes: Vec<Vec<u8>> = annotations.iter().map(encode).collect();
        let (all, longest) = notes.iter().fold((0, 0), |(all, longest), note| {
            (all + note.len(), usize::max(longest, note.len()))
        });
        let time = time_of(records, fraction_s).len();
        let room = all.div_ceil(records) + longest;
        let mut spread: Vec<Vec<u8>> = vec![Vec::new(); records];
        let mut record = 0;
        for note in notes {
            if spread[record].len() + note.len() > room {
                record += 1;
            }
            spread[record].extend(note);
        }
        Self { records: spread, capacity: (time + room).next_multiple_of(BYTES), fraction_s }
    }

    /// The annotation signal of a record.
    fn of_record(&self, record: usize) -> Vec<u8> {
        let mut bytes = time_of(record, self.fraction_s);
        bytes.extend(self.records.get(record).into_iter().flatten());
        bytes.resize(self.capacity, 0);
        bytes
    }
}

/// The annotation with which each record begins: when its samples do.
fn time_of(record: usize, fraction_s: f64) -> Vec<u8> {
    format!("{:+.9}\x14\x14\0", record as f64 + fraction_s).into_bytes()
}

/// A unit as the header can hold it.
fn ascii_unit(unit: &str) -> String {
    // The sign for micro, and the Greek letter.
    unit.replace(['\u{b5}', '\u{3bc}'], "u").replace('·', ".")
}

/// The largest value of a signal, rounded up to what its eight characters hold with a sign.
fn limit(signal: &BdfSignal<'_>) -> anyhow::Result<String> {
    let unit = ascii_unit(signal.unit);
    if !unit.chars().all(|c| c.is_ascii_graphic()) || unit.len() > 8 {
        bail!(
            "channel {}: a BDF file has units of at most eight ASCII characters, not \"{}\": \
             change it in the rig file",
            signal.label,
            signal.unit
        );
    }
    let mut largest = signal.range.abs();
    signal.values.cursor().each(|value| {
        if value.is_finite() {
            largest = largest.max(value.abs());
        }
    })?;
    for decimals in (0..=5).rev() {
        let scale = f64::powi(10.0, decimals);
        let rounded = ((largest * scale).ceil() / scale).max(1.0 / scale);
        let text = format!("{rounded:.0$}", decimals as usize);
        if text.len() < LIMIT {
            return Ok(text);
        }
    }
    bail!(
        "channel {}: a BDF file holds values up to 9999999 {unit}, not {largest}: choose a larger \
         unit in the rig file",
        signal.label,
        unit = signal.unit
    )
}

/// The header's records, each padded with blanks.
fn encode_header(
    header: &BdfHeader<'_>,
    signals: &[BdfSignal<'_>],
    limits: &[String],
    records: usize,
    capacity: usize,
) -> Vec<u8> {
    let (day, time) = day_and_time(header.began_ns);
    let [year, month, date] = day;
    let name = month.parse::<usize>().ok().and_then(|month| MONTHS.get(month.wrapping_sub(1)));
    let recording = format!(
        "Startdate {date}-{}-{year} X X {}",
        name.unwrap_or(&"JAN"),
        header.equipment.replace(' ', "_")
    );
    let mut bytes = vec![0xff];
    let mut put = |text: &str, length: usize| bytes.extend(padded(text, length));
    put("BIOSEMI", 7);
    put(&format!("{} X X X", header.subject.replace(' ', "_")), 80);
    put(&recording, 80);
    put(&format!("{date}.{month}.{}", &year[year.len().saturating_sub(2)..]), 8);
    put(&time.replace(':', "."), 8);
    put(&(256 * (signals.len() + 2)).to_string(), 8);
    put("BDF+C", 44);
    put(&records.to_string(), 8);
    put("1", 8);
    put(&(signals.len() + 1).to_string(), 4);
    let mut field = |length: usize, of: &dyn Fn(usize) -> String, notes: &str| {
        (0..signals.len()).for_each(|at| put(&of(at), length));
        put(notes, length);
    };
    field(16, &|at| signals[at].label.to_owned(), "BDF Annotations");
    field(80, &|at| signals[at].transducer.to_owned(), "");
    field(8, &|at| ascii_unit(signals[at].unit), "");
    field(LIMIT, &|at| format!("-{}", limits[at]), "-1");
    field(LIMIT, &|at| limits[at].clone(), "1");
    field(8, &|_| (-LARGEST).to_string(), "-8388608");
    field(8, &|_| LARGEST.to_string(), "8388607");
    field(80, &|_| String::new(), "");
    field(8, &|_| header.rate_hz.to_string(), &(capacity / BYTES).to_string());
    field(32, &|_| String::new(), "");
    bytes
}

/// The ASCII characters of a text, cut or padded with blanks.
fn padded(text: &str, length: usize) -> Vec<u8> {
    let printable = |c: &char| c.is_ascii_graphic() || *c == ' ';
    let mut bytes: Vec<u8> = text.chars().filter(printable).map(|c| c as u8).collect();
    bytes.resize(length, b' ');
    bytes
}

/// Year, month and day, and the time, of an instant since 1970, UTC.
fn day_and_time(at_ns: u64) -> ([String; 3], String) {
    let at = UNIX_EPOCH + Duration::from_nanos(at_ns);
    let text = humantime::format_rfc3339_seconds(at).to_string();
    let (day, time) = text.trim_end_matches('Z').split_once('T').unwrap_or_default();
    let mut parts = day.split('-').map(str::to_owned);
    let mut next = || parts.next().unwrap_or_default();
    ([next(), next(), next()], time.to_owned())
}

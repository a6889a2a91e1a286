//! Writes a recording with messages of every topic, and beside it the same messages as JSON lines
//! made from the messages themselves, not from the file: the reference for readers of other
//! projects (`.ci/readers`).
//!
//! ```text
//! $ cargo run -p recording --example reader_check -- OUT.mcap OUT.jsonl
//! ```

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use ipc_types::{Primitive, TOPICS, Value};
use recording::mcap_write::{Start, Writer, key};

const MESSAGES: u64 = 200;
const OFFSET_NS: i64 = 1_700_000_000_000_000_000;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let (Some(mcap), Some(json)) = (arguments.next(), arguments.next()) else {
        return Err("expected two file names: OUT.mcap OUT.jsonl".into());
    };
    let start =
        Start { realtime_offset_ns: OFFSET_NS, ..Start::default() }.with(key::RIG, "reader-check");
    let mut writer = Writer::create(Path::new(&mcap), &start, 0)?;
    let mut json = BufWriter::new(File::create_new(json)?);
    let mut noise = 0x9e37_79b9_7f4a_7c15u64;
    for sequence in 0..MESSAGES {
        for (index, topic) in TOPICS.iter().enumerate() {
            let time_ns = (sequence + 1) * 500_000 + index as u64;
            let mut bytes = vec![0u8; topic.size];
            for field in topic.fields {
                for element in 0..field.count() {
                    noise = noise
                        .wrapping_mul(6_364_136_223_846_793_005)
                        .wrapping_add(1_442_695_040_888_963_407);
                    let word = match field.name {
                        "sequence" => sequence,
                        "time_ns" => time_ns,
                        _ => value(field.primitive, noise, sequence),
                    };
                    let size = field.primitive.size();
                    let at = field.offset + element * size;
                    bytes[at..at + size].copy_from_slice(&word.to_le_bytes()[..size]);
                }
            }
            writer.write(index, &bytes)?;
            let fields: serde_json::Map<String, serde_json::Value> = topic
                .fields
                .iter()
                .map(|field| {
                    let values: Vec<serde_json::Value> = (0..field.count())
                        .filter_map(|i| field.read(&bytes, i))
                        .map(number)
                        .collect();
                    let value = match field.array {
                        Some(_) => values.into(),
                        None => values.into_iter().next().unwrap_or_default(),
                    };
                    (field.name.to_owned(), value)
                })
                .collect();
            let line = serde_json::json!({
                "topic": topic.name,
                "type": topic.ros_name,
                "log_time_ns": time_ns + OFFSET_NS as u64,
                "sequence": sequence,
                "fields": fields,
            });
            writeln!(json, "{line}")?;
        }
        writer.tick(sequence * 50_000_000)?;
    }
    writer.finish(&[])?;
    json.flush()?;
    Ok(())
}

/// The bits of a value: any for integers; for floats ordinary numbers with all kinds of special
/// ones among them.
fn value(primitive: Primitive, noise: u64, sequence: u64) -> u64 {
    match primitive {
        Primitive::F64 => match sequence % 8 {
            0 => f64::NAN.to_bits(),
            1 => f64::NEG_INFINITY.to_bits(),
            2 => (-0.0f64).to_bits(),
            3 => noise & 0x000f_ffff_ffff_ffff, // subnormal
            _ => ((noise >> 11) as f64 / (1u64 << 52) as f64 - 1.0).to_bits(),
        },
        _ => noise.rotate_left(17),
    }
}

fn number(value: Value) -> serde_json::Value {
    match value {
        Value::Unsigned(v) => v.into(),
        Value::Signed(v) => v.into(),
        Value::Float(v) if v.is_finite() => v.into(),
        Value::Float(v) => v.to_string().into(),
    }
}

//! Changes of JSON that leave it JSON.

use serde_json::{Map, Value, json};

use crate::changed_bytes::changed;
use crate::mutated::Numbers;

/// A text with a value, key or entry changed; where it is no JSON, and now and then, with bytes
/// changed.
pub(crate) fn broken(body: &[u8], other: &[u8], numbers: &mut Numbers) -> Vec<u8> {
    let value = serde_json::from_slice::<Value>(body).ok().filter(|_| numbers.below(5) > 0);
    let Some(mut value) = value else { return changed(body, other, numbers) };
    let other = serde_json::from_slice::<Value>(other).unwrap_or_default();
    for _ in 0..=numbers.below(2) {
        change(&mut value, &other, numbers);
    }
    value.to_string().into_bytes()
}

fn change(value: &mut Value, other: &Value, numbers: &mut Numbers) {
    match value {
        Value::Object(entries) if !entries.is_empty() && numbers.below(4) > 0 => {
            let at = numbers.below(entries.len());
            let Some(key) = entries.keys().nth(at).cloned() else { return };
            match numbers.below(8) {
                0 => drop(entries.remove(&key)),
                1 => drop(entries.insert("another".to_owned(), Value::from(1))),
                2 => {
                    let moved = entries.remove(&key).unwrap_or_default();
                    entries.insert(format!("{key}\u{0}"), moved);
                }
                _ => change(entries.entry(key).or_insert(Value::Null), other, numbers),
            }
        }
        Value::Array(list) if !list.is_empty() && numbers.below(4) > 0 => {
            let at = numbers.below(list.len());
            match numbers.below(6) {
                0 => drop(list.remove(at)),
                1 => list.insert(at, list[at].clone()),
                _ => change(&mut list[at], other, numbers),
            }
        }
        value => *value = another(other, numbers),
    }
}

/// A value in place of another.
fn another(other: &Value, numbers: &mut Numbers) -> Value {
    match numbers.below(18) {
        0 => Value::Null,
        1 => json!(true),
        2 => json!(0),
        3 => json!(-1),
        4 => json!(u64::MAX),
        5 => json!(i64::MIN),
        6 => json!(1e308),
        7 => json!(5e-324),
        8 => json!(4_294_967_296_u64),
        9 => json!(""),
        10 => json!("\u{0}\u{1f980}\n"),
        11 => json!("x".repeat(1 + numbers.below(300))),
        12 => json!([]),
        13 => json!({}),
        14 => json!([[[[0]]]]),
        15 => Value::Object(Map::from_iter([("value".to_owned(), json!(1))])),
        16 => json!(numbers.below(1 << 31)),
        _ => other.clone(),
    }
}

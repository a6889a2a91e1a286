//! Values as they are written into a rig file.

use toml_edit::{Item, TableLike, Value};

/// A number with eight digits: more than any record can resolve, and short enough to be read.
pub(super) fn number(value: f64) -> Value {
    let value: f64 = format!("{value:.7e}").parse().unwrap_or(value);
    let plain = value == 0.0 || (1e-3..1e6).contains(&value.abs());
    // Parsed from text, since a number would be written without an exponent.
    if plain {
        Value::from(value)
    } else {
        format!("{value:e}").parse().unwrap_or(Value::from(value))
    }
}

/// Rounded up to two digits.
pub(super) fn rounded_up(value: f64) -> f64 {
    if value <= 0.0 {
        return 0.0;
    }
    let unit = 10f64.powf(value.log10().floor() - 1.0);
    format!("{:.1e}", (value / unit - 1e-6).ceil() * unit).parse().unwrap_or(value)
}

/// Sets a key; spaces and comments around it and its value are kept.
pub(super) fn replace(table: &mut dyn TableLike, key: &str, mut value: Value) {
    match table.get_mut(key) {
        Some(Item::Value(old)) => {
            *value.decor_mut() = old.decor().clone();
            *old = value;
        }
        _ => _ = table.insert(key, Item::Value(value)),
    }
}

//! Where two messages differ, to the last bit.

use ipc_types::{Message, Value};
use serde::Serialize;

/// The first field in which a recomputed message differs from the recorded one.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FieldDifference {
    /// The field, with its index where it is an array: `volts[0]`.
    pub field: String,
    /// Its value in the recording.
    pub recorded: Value,
    /// Its value as computed again.
    pub recomputed: Value,
}

/// The first field that differs, of those that are `compared`.
pub(crate) fn first_difference<T: Message>(
    recorded: &T,
    recomputed: &T,
    compared: impl Fn(&str) -> bool,
) -> Option<FieldDifference> {
    let (was, is) = (recorded.as_bytes(), recomputed.as_bytes());
    T::FIELDS.iter().filter(|field| compared(field.name)).find_map(|field| {
        (0..field.count()).find_map(|index| {
            let (recorded, recomputed) = (field.read(was, index)?, field.read(is, index)?);
            (bits(recorded) != bits(recomputed)).then(|| FieldDifference {
                field: match field.array {
                    Some(_) => format!("{}[{index}]", field.name),
                    None => field.name.to_owned(),
                },
                recorded,
                recomputed,
            })
        })
    })
}

/// The bits of a value: a number that is not finite equals itself, and -0 differs from 0.
const fn bits(value: Value) -> u64 {
    match value {
        Value::Unsigned(value) => value,
        Value::Signed(value) => value as u64,
        Value::Float(value) => value.to_bits(),
    }
}

#[cfg(test)]
mod tests {
    use ipc_types::MotorCommand;

    use super::*;

    #[test]
    fn the_last_bit_the_sign_of_zero_and_the_index_count() {
        let recorded = MotorCommand { volts: [0.1, f64::NAN, 0.0], ..MotorCommand::default() };
        assert_eq!(first_difference(&recorded, &recorded, |_| true), None);
        let mut other = recorded;
        other.volts[2] = -0.0;
        let found = first_difference(&recorded, &other, |_| true).unwrap();
        assert_eq!(found.field, "volts[2]");
        assert_eq!(first_difference(&recorded, &other, |name| name != "volts"), None);
        other = recorded;
        other.volts[0] = f64::from_bits(0.1f64.to_bits() + 1);
        other.mode = 3;
        let found = first_difference(&recorded, &other, |_| true).unwrap();
        assert_eq!((found.field.as_str(), found.recorded), ("volts[0]", Value::Float(0.1)));
        let found = first_difference(&recorded, &other, |name| name != "volts").unwrap();
        assert_eq!((found.field.as_str(), found.recomputed), ("mode", Value::Unsigned(3)));
    }
}

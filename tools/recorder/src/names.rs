//! What this build knows of the fields of messages: names of codes, and units.

use ipc_types::{Field, TOPICS, Value};

/// The name of a code in a field of a message type; `None` for fields that carry no code, and for
/// codes that this build does not know.
pub(crate) fn code_name(message: &str, field: &str, code: u64) -> Option<&'static str> {
    field_of(message, field)?.meaning(Value::Unsigned(code))
}

/// The unit of a field of a message type; empty where it has none, or this build does not know the
/// field.
pub(crate) fn unit_of(message: &str, field: &str) -> &'static str {
    field_of(message, field).map(Field::unit).unwrap_or_default()
}

fn field_of(message: &str, field: &str) -> Option<&'static Field> {
    let topic = TOPICS.iter().find(|topic| topic.ros_name == message)?;
    topic.fields.iter().find(|known| known.name == field)
}

//! Names of the codes that messages carry.

use ipc_types::{TOPICS, Value};

/// The name of a code in a field of a message type; `None` for fields that carry no code, and for
/// codes that this build does not know.
pub(crate) fn code_name(message: &str, field: &str, code: u64) -> Option<&'static str> {
    let topic = TOPICS.iter().find(|topic| topic.ros_name == message)?;
    let field = topic.fields.iter().find(|known| known.name == field)?;
    field.meaning(Value::Unsigned(code))
}

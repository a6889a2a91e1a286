//! The layout of a message, from the schema in the recording.
//!
//! farreach's messages are flat: scalars and arrays of fixed length of the six numeric types in
//! [`ipc_types::Primitive`], and constants, which take no space. Offsets follow plain CDR (each
//! field aligned to its own size, counted from behind the four-byte header), so that a schema
//! without explicit padding is read correctly too.

use ipc_types::{CDR_HEADER, Field, Message, Primitive, Value};
use re_ros_msg::MessageSchema;
use re_ros_msg::message_spec::{ArraySize, BuiltInType, Type};

use crate::channel::SCHEMA_ENCODING;

/// Why a message of a recording cannot be decoded: its schema is not written in `ros2msg`, cannot
/// be parsed, or has a field that is no number; or the payload is not little-endian CDR, or short.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("schema {0}")]
pub struct SchemaError(String);

/// One field of a recorded message; offsets count from behind the CDR header.
pub type LayoutField = Field<String>;

/// The value of an unsigned scalar field in the body of a message; `None` for other fields.
pub(crate) fn unsigned(field: &LayoutField, body: &[u8]) -> Option<u64> {
    match field.read(body, 0)? {
        Value::Unsigned(value) => Some(value),
        _ => None,
    }
}

/// The layout of one message type.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layout {
    /// Name of the type.
    pub name: String,
    /// Fields in order.
    pub fields: Vec<LayoutField>,
    /// Bytes of a message (CDR header excluded).
    pub size: usize,
}

/// Largest message that a schema may declare [bytes]: a damaged length must not take all memory.
const LARGEST: usize = 1 << 24;

impl Layout {
    /// Reads a schema.
    ///
    /// # Errors
    /// [`SchemaError`].
    pub fn parse(name: &str, encoding: &str, text: &str) -> Result<Self, SchemaError> {
        if encoding != SCHEMA_ENCODING {
            let text = format!("{name}: expected encoding {SCHEMA_ENCODING}, found {encoding}");
            return Err(SchemaError(text));
        }
        let schema = MessageSchema::parse(name, text)
            .map_err(|error| SchemaError(format!("{name}: {error:#}")))?;
        let mut fields = Vec::with_capacity(schema.spec.fields.len());
        let mut size = 0usize;
        for field in schema.spec.fields {
            let unsupported = || {
                SchemaError(format!(
                    "{name}, field {}: expected a number or a fixed array of numbers, found {:?}: \
                     nested, text and variable types are not supported",
                    field.name, field.ty
                ))
            };
            let (base, array) = match &field.ty {
                Type::Array { ty, size: ArraySize::Fixed(length) } => (ty.as_ref(), Some(*length)),
                other => (other, None),
            };
            let primitive = primitive_of(base).ok_or_else(unsupported)?;
            let offset = size.next_multiple_of(primitive.size());
            size = primitive
                .size()
                .checked_mul(array.unwrap_or(1))
                .and_then(|bytes| offset.checked_add(bytes))
                .filter(|&end| end <= LARGEST)
                .ok_or_else(unsupported)?;
            let name = field.name;
            fields.push(Field { name, primitive, array, offset, doc: "", codes: &[] });
        }
        Ok(Self { name: name.to_owned(), fields, size })
    }

    /// The field of that name.
    pub fn field(&self, name: &str) -> Option<&LayoutField> {
        self.fields.iter().find(|field| field.name == name)
    }

    /// The value of an unsigned scalar field; `None` where there is no such field.
    pub fn unsigned(&self, name: &str, body: &[u8]) -> Option<u64> {
        unsigned(self.field(name)?, body)
    }

    /// The message within a CDR payload.
    ///
    /// # Errors
    /// [`SchemaError`] where the header differs or bytes are missing.
    pub fn body<'a>(&self, payload: &'a [u8]) -> Result<&'a [u8], SchemaError> {
        payload.strip_prefix(&CDR_HEADER).and_then(|body| body.get(..self.size)).ok_or_else(|| {
            SchemaError(format!(
                "{}: expected little-endian CDR of {} bytes, found {} bytes beginning with {:02x?}",
                self.name,
                CDR_HEADER.len() + self.size,
                payload.len(),
                &payload[..payload.len().min(4)],
            ))
        })
    }

    /// Whether it lays out its fields exactly as this build's `T` does.
    pub fn matches<T: Message>(&self) -> bool {
        self.size == size_of::<T>()
            && self.fields.len() == T::FIELDS.len()
            && self.fields.iter().zip(T::FIELDS).all(|(ours, theirs)| {
                ours.name == theirs.name
                    && ours.primitive == theirs.primitive
                    && ours.array == theirs.array
                    && ours.offset == theirs.offset
            })
    }

    /// How to read this layout into this build's `T`: fields are matched by name and type; fields
    /// that the recording lacks are zero.
    pub fn conversion<T: Message>(&self) -> Conversion {
        let mut conversion =
            Conversion { size: size_of::<T>(), copies: Vec::new(), missing: Vec::new() };
        if self.matches::<T>() {
            conversion.copies.push((0, 0, conversion.size));
            return conversion;
        }
        for field in T::FIELDS {
            match self.field(field.name).filter(|ours| ours.primitive == field.primitive) {
                Some(ours) => {
                    let bytes = ours.count().min(field.count()) * field.primitive.size();
                    conversion.copies.push((ours.offset, field.offset, bytes));
                }
                None => conversion.missing.push(field.name),
            }
        }
        conversion
    }
}

/// Copies the fields of a recorded layout into a message of this build.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Conversion {
    size: usize,
    /// from, to, bytes
    copies: Vec<(usize, usize, usize)>,
    /// Fields of this build that the recording does not have: they read as zero.
    pub missing: Vec<&'static str>,
}

impl Conversion {
    /// The message; `None` where `body` is shorter than its layout.
    pub fn apply<T: Message>(&self, body: &[u8]) -> Option<T> {
        if let [(0, 0, whole)] = self.copies[..]
            && whole == self.size
        {
            return T::from_bytes(body.get(..whole)?);
        }
        let mut bytes = vec![0u8; self.size];
        for &(from, to, length) in &self.copies {
            bytes.get_mut(to..to + length)?.copy_from_slice(body.get(from..from + length)?);
        }
        T::from_bytes(&bytes)
    }
}

fn primitive_of(kind: &Type) -> Option<Primitive> {
    let Type::BuiltIn(kind) = kind else { return None };
    Some(match kind {
        BuiltInType::UInt8 | BuiltInType::Byte | BuiltInType::Bool | BuiltInType::Char => {
            Primitive::U8
        }
        BuiltInType::UInt16 => Primitive::U16,
        BuiltInType::UInt32 => Primitive::U32,
        BuiltInType::UInt64 => Primitive::U64,
        BuiltInType::Int64 => Primitive::I64,
        BuiltInType::Float64 => Primitive::F64,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use ipc_types::{MotorCommand, Sample, TOPICS};

    use super::*;

    #[test]
    fn the_schema_of_every_topic_reads_back_as_its_field_table() {
        for topic in TOPICS {
            let layout = Layout::parse(topic.ros_name, "ros2msg", &(topic.schema)()).unwrap();
            assert_eq!(layout.size, topic.size, "{}", topic.name);
            for (ours, theirs) in layout.fields.iter().zip(topic.fields) {
                assert_eq!(
                    (ours.name.as_str(), ours.primitive, ours.array, ours.offset),
                    (theirs.name, theirs.primitive, theirs.array, theirs.offset)
                );
            }
        }
    }

    #[test]
    fn fields_are_aligned_as_in_cdr_and_constants_take_no_space() {
        let text =
            "uint8 A=3\nuint8 a # trailing\nfloat64 b\nuint8 B_LONG = 7\nuint16[3] c\nuint32 d\n";
        let layout = Layout::parse("x", "ros2msg", text).unwrap();
        let offsets: Vec<_> = layout.fields.iter().map(|f| f.offset).collect();
        assert_eq!((offsets, layout.size), (vec![0, 8, 16, 24], 28));
    }

    #[test]
    fn a_schema_that_is_not_flat_is_refused_by_field() {
        for (text, expected) in [
            ("uint8 a\nstring b", "field b"),
            ("uint8[] a", "field a"),
            ("uint8[<=3] a", "field a"),
            ("geometry_msgs/Point p", "field p"),
            ("uint64[9999999999999999] a", "field a"),
            ("uint64[99999999999999999999] a", "99999999999999999999"),
            ("uint8 a b", "`b`"),
            ("uint8", "missing name"),
        ] {
            let error = Layout::parse("x", "ros2msg", text).unwrap_err().to_string();
            assert!(error.starts_with("schema x") && error.contains(expected), "{text}: {error}");
        }
        let error = Layout::parse("x", "protobuf", "").unwrap_err().to_string();
        assert_eq!(error, "schema x: expected encoding ros2msg, found protobuf");
    }

    #[test]
    fn an_older_layout_is_matched_by_name() {
        let old = Layout::parse(
            "farreach/msg/MotorCommand",
            "ros2msg",
            "uint64 session\nuint64 sequence\nuint64 gone\nfloat64[2] volts\nuint8 mode\n",
        )
        .unwrap();
        let mut body = Vec::new();
        for value in [11u64, 12, 13] {
            body.extend_from_slice(&value.to_le_bytes());
        }
        for value in [1.5f64, -2.5] {
            body.extend_from_slice(&value.to_le_bytes());
        }
        body.push(2);
        let conversion = old.conversion::<MotorCommand>();
        assert!(
            conversion.missing.contains(&"incarnation") && !conversion.missing.contains(&"volts")
        );
        let command: MotorCommand = conversion.apply(&body).unwrap();
        assert_eq!(
            (command.session, command.sequence, command.incarnation, command.mode),
            (11, 12, 0, 2)
        );
        assert_eq!(command.volts, [1.5, -2.5, 0.0]);
        assert_eq!(conversion.apply::<MotorCommand>(&body[..20]), None);
        assert!(!old.matches::<Sample>());
    }
}

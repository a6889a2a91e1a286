//! The layout of a message: field table, schema, bytes, and the macro that generates them.

use iceoryx2_bb_elementary_traits::zero_copy_send::ZeroCopySend;

/// Encapsulation header of a little-endian plain CDR message.
pub const CDR_HEADER: [u8; 4] = [0x00, 0x01, 0x00, 0x00];

/// Defines the primitive types that a message may hold, with their names in Rust and in `ros2msg`.
macro_rules! primitives {
    ($($name:ident $type:ty, $ros:literal;)+) => {
        /// The primitive types that a message may hold.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[allow(missing_docs)]
        pub enum Primitive { $($name,)+ }

        impl Primitive {
            /// Size, and alignment, in bytes.
            pub const fn size(self) -> usize {
                match self { $(Self::$name => size_of::<$type>(),)+ }
            }

            /// The name in a `ros2msg` schema.
            pub const fn ros(self) -> &'static str {
                match self { $(Self::$name => $ros,)+ }
            }
        }

        $(impl Element for $type {
            const PRIMITIVE: Primitive = Primitive::$name;
            const ARRAY: Option<usize> = None;
        }
        impl<const N: usize> Element for [$type; N] {
            const PRIMITIVE: Primitive = Primitive::$name;
            const ARRAY: Option<usize> = Some(N);
        })+
    };
}

primitives! {
    U8 u8, "uint8";
    U16 u16, "uint16";
    U32 u32, "uint32";
    U64 u64, "uint64";
    I64 i64, "int64";
    F64 f64, "float64";
}

/// Implemented for the element types of fields.
#[doc(hidden)]
pub(crate) trait Element {
    const PRIMITIVE: Primitive;
    const ARRAY: Option<usize>;
}

/// One element of a field, read out of a message's bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Value {
    /// Any unsigned integer field.
    Unsigned(u64),
    /// Any signed integer field.
    Signed(i64),
    /// Any floating-point field.
    Float(f64),
}

impl Value {
    /// The value as a float (integers above 2^53 lose their lowest bits).
    pub fn as_f64(self) -> f64 {
        match self {
            Self::Unsigned(v) => v as f64,
            Self::Signed(v) => v as f64,
            Self::Float(v) => v,
        }
    }
}

impl std::fmt::Display for Value {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Unsigned(v) => v.fmt(f),
            Self::Signed(v) => v.fmt(f),
            Self::Float(v) => v.fmt(f),
        }
    }
}

impl serde::Serialize for Value {
    /// As a number. JSON has neither NaN nor infinity: these become text.
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Unsigned(v) => serializer.serialize_u64(*v),
            Self::Signed(v) => serializer.serialize_i64(*v),
            Self::Float(v) if v.is_finite() => serializer.serialize_f64(*v),
            Self::Float(v) => serializer.collect_str(v),
        }
    }
}

/// One field of a message: where it lies, what it holds, what its doc comment says. A layout that
/// was read from a recording owns its names ([`String`]) and has neither documentation nor codes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field<Name = &'static str> {
    /// Name, as in the struct.
    pub name: Name,
    /// Type of one element.
    pub primitive: Primitive,
    /// Length if the field is an array, `None` for a scalar.
    pub array: Option<usize>,
    /// Bytes from the start of the message.
    pub offset: usize,
    /// The field's documentation, unit included.
    pub doc: &'static str,
    /// What the values of a coded field mean; empty for a number.
    pub codes: &'static [Code],
}

/// One value of a coded field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Code {
    /// The value in the message.
    pub value: u8,
    /// Name of the variant in the code, `ProcessStarted`.
    pub name: &'static str,
    /// In words, "process started".
    pub text: &'static str,
}

impl<Name: AsRef<str>> Field<Name> {
    /// Number of elements.
    pub const fn count(&self) -> usize {
        match self.array {
            Some(n) => n,
            None => 1,
        }
    }

    /// Its unit, from its documentation; empty where that ends with none in brackets.
    pub fn unit(&self) -> &'static str {
        let doc = self.doc.trim();
        let given = [('(', ')'), ('[', ']')].into_iter().find_map(|(open, close)| {
            let (_, unit) = doc.strip_suffix(close)?.rsplit_once(open)?;
            Some(unit.split_once(',').map_or(unit, |(unit, _)| unit))
        });
        // Longer text in brackets is an explanation.
        given.filter(|unit| unit.chars().count() <= 16).unwrap_or_default()
    }

    /// What a value of this field means, in words: "process started" for 0 in an event's `kind`.
    /// `None` where the field is a number, or the code is not known to this build.
    pub fn meaning(&self, value: Value) -> Option<&'static str> {
        let Value::Unsigned(value) = value else { return None };
        self.codes.iter().find(|code| u64::from(code.value) == value).map(|code| code.text)
    }

    /// The codes as `ros2msg` constants, one a line: `uint8 KIND_PROCESS_STARTED=0`.
    fn constants(&self) -> String {
        let ros = self.primitive.ros();
        let prefix = self.name.as_ref().to_uppercase();
        let mut lines = String::new();
        for code in self.codes {
            let mut name = String::new();
            for letter in code.name.chars() {
                if letter.is_uppercase() {
                    name.push('_');
                }
                name.extend(letter.to_uppercase());
            }
            lines.push_str(&format!("{ros} {prefix}{name}={}\n", code.value));
        }
        lines
    }

    /// All elements, as far as the bytes of a message hold them.
    pub fn read_all<'a>(&'a self, bytes: &'a [u8]) -> impl Iterator<Item = Value> + 'a {
        (0..self.count()).map_while(|index| self.read(bytes, index))
    }

    /// The value as text: a number, or `[a,b,...]` for an array.
    pub fn values_text(&self, bytes: &[u8]) -> String {
        let values: Vec<_> = self.read_all(bytes).map(|value| value.to_string()).collect();
        if self.array.is_some() { format!("[{}]", values.join(",")) } else { values.concat() }
    }

    /// The field that holds the used length of this one, if this one is an event's text; `fields`
    /// are those of the message.
    pub fn text_length<'f>(&self, fields: &'f [Self]) -> Option<&'f Self> {
        let is_text = self.name.as_ref() == "text" && self.array.is_some();
        fields.iter().find(|other| is_text && other.name.as_ref() == "text_len")
    }

    /// An event's text; `None` for any other field.
    pub fn event_text(&self, fields: &[Self], bytes: &[u8]) -> Option<String> {
        let length = self.text_length(fields)?.read(bytes, 0)?.as_f64() as usize;
        let text: Vec<u8> =
            self.read_all(bytes).take(length).map(|value| value.as_f64() as u8).collect();
        Some(String::from_utf8_lossy(&text).into_owned())
    }

    /// Element `index` out of the bytes of a message; `None` where the bytes are too short.
    pub fn read(&self, bytes: &[u8], index: usize) -> Option<Value> {
        if index >= self.count() {
            return None;
        }
        let size = self.primitive.size();
        let at = self.offset + index * size;
        let mut raw = [0u8; 8];
        raw[..size].copy_from_slice(bytes.get(at..at + size)?);
        let unsigned = u64::from_le_bytes(raw);
        Some(match self.primitive {
            Primitive::U8 | Primitive::U16 | Primitive::U32 | Primitive::U64 => {
                Value::Unsigned(unsigned)
            }
            Primitive::I64 => Value::Signed(unsigned as i64),
            Primitive::F64 => Value::Float(f64::from_bits(unsigned)),
        })
    }
}

/// A message of fixed layout.
///
/// # Safety
/// Only `messages!` implements it: the type is `#[repr(C)]`, has no padding, holds only integers
/// and floats (so that every bit pattern is valid) and begins with `session`, `incarnation`,
/// `sequence`, `time_ns`.
pub unsafe trait Message:
    ZeroCopySend + Copy + Send + Sync + std::fmt::Debug + 'static
{
    /// Name of the type in shared memory, with its version: two builds that disagree refuse each
    /// other.
    const TYPE_NAME: &'static str;
    /// Name of the type in recordings.
    const ROS_NAME: &'static str;
    /// The fields in order.
    const FIELDS: &'static [Field];

    /// All fields zero.
    fn zeroed() -> Self;

    /// Session of the rig: drawn by the keeper at each cold start.
    fn session(&self) -> u64;
    /// Incarnation of the sender: drawn at each start of a process.
    fn incarnation(&self) -> u64;
    /// Sequence number, from 0, counted per incarnation and topic.
    fn sequence(&self) -> u64;
    /// When it was published, in ns of `CLOCK_MONOTONIC`.
    fn time_ns(&self) -> u64;
    /// Stamps identity, sequence and time; for the publisher's wrapper.
    fn stamp(&mut self, session: u64, incarnation: u64, sequence: u64, time_ns: u64);

    /// The message's bytes: the body of a CDR message.
    fn as_bytes(&self) -> &[u8] {
        // SAFETY: no padding and only plain numbers (the trait's contract), so every byte is
        // initialised.
        unsafe {
            std::slice::from_raw_parts(std::ptr::from_ref(self).cast::<u8>(), size_of::<Self>())
        }
    }

    /// A message out of its bytes; `None` where the length differs.
    fn from_bytes(bytes: &[u8]) -> Option<Self> {
        // SAFETY: the length is checked, any bit pattern is valid (the trait's contract), unaligned
        // read.
        (bytes.len() == size_of::<Self>())
            .then(|| unsafe { bytes.as_ptr().cast::<Self>().read_unaligned() })
    }

    /// The `ros2msg` schema, generated from the field table.
    fn schema() -> String {
        let mut text = String::new();
        for field in Self::FIELDS {
            text.push_str(&schema_comment(field.doc));
            text.push_str(&field.constants());
            text.push_str(field.primitive.ros());
            if let Some(n) = field.array {
                text.push_str(&format!("[{n}]"));
            }
            text.push(' ');
            text.push_str(field.name);
            text.push('\n');
        }
        text
    }
}

/// What is done with a message type that is known at run time only; see
/// [`visit_type`](crate::visit_type).
pub trait TypeVisitor {
    /// What comes of it.
    type Output;
    /// Does it with the type.
    fn visit<T: Message>(self) -> Self::Output;
}

/// Wraps text into comment lines of a `ros2msg` schema, at most 100 columns each.
pub fn schema_comment(text: &str) -> String {
    let mut comment = String::from("#");
    let mut column = 1;
    for word in text.split_whitespace() {
        let width = 1 + word.chars().count();
        if column > 1 && column + width > 100 {
            comment.push_str("\n#");
            column = 1;
        }
        comment.push(' ');
        comment.push_str(word);
        column += width;
    }
    comment.push('\n');
    comment
}

/// Defines all messages, and the function that finds their types.
macro_rules! messages {
    ($($(#[doc = $doc:literal])+ $name:ident $version:ident { $($fields:tt)+ })+) => {
        $($crate::message::message! { $(#[doc = $doc])+ $name $version { $($fields)+ } })+

        /// Calls the visitor with the message type of that name; gives it back where no message of
        /// this list has the name.
        pub(crate) fn visit<V: $crate::TypeVisitor>(
            name: &str,
            visitor: V,
        ) -> Result<V::Output, V> {
            $(if name == <$name as $crate::Message>::TYPE_NAME {
                return Ok(visitor.visit::<$name>());
            })+
            Err(visitor)
        }
    };
}
pub(crate) use messages;

/// Defines a message: the struct, its field table, its schema, and compile-time proof that it has
/// no padding anywhere (each field begins where the one before ends). The macro puts the identity
/// fields first. `Name v1` gives the version of the layout, which rises with every change of it.
/// `field: u8 = Code` says which enumeration of `codes.rs` a field holds.
macro_rules! message {
    (
        $(#[doc = $doc:literal])+
        $name:ident $version:ident {
            $($(#[doc = $field_doc:literal])+ $field:ident : $type:ty $(= $code:ident)?,)+
        }
    ) => {
        $crate::message::message! {
            @all $(#[doc = $doc])+
            $name $version {
                /// session of the rig
                session: u64,
                /// incarnation of the sender
                incarnation: u64,
                /// sequence number, per incarnation
                sequence: u64,
                /// time of publishing [ns, CLOCK_MONOTONIC]
                time_ns: u64,
                $($(#[doc = $field_doc])+ $field: $type $(= $code)?,)+
            }
        }
    };
    (
        @all $(#[doc = $doc:literal])+
        $name:ident $version:ident {
            $($(#[doc = $field_doc:literal])+ $field:ident : $type:ty $(= $code:ident)?,)+
        }
    ) => {
        $(#[doc = $doc])+
        #[derive(Clone, Copy, Debug, PartialEq)]
        #[repr(C)]
        pub struct $name { $($(#[doc = $field_doc])+ pub $field: $type,)+ }

        // SAFETY: `#[repr(C)]`, self-contained, no pointers, layout fixed by the assertions below.
        unsafe impl iceoryx2_bb_elementary_traits::zero_copy_send::ZeroCopySend for $name {
            unsafe fn type_name() -> &'static str { <Self as $crate::Message>::TYPE_NAME }
        }

        // SAFETY: generated by this macro; the assertions below hold.
        unsafe impl $crate::Message for $name {
            const TYPE_NAME: &'static str =
                concat!("farreach.", stringify!($name), ".", stringify!($version));
            const ROS_NAME: &'static str = concat!("farreach/msg/", stringify!($name));
            const FIELDS: &'static [$crate::Field] = &[$($crate::Field {
                name: stringify!($field),
                primitive: <$type as $crate::message::Element>::PRIMITIVE,
                array: <$type as $crate::message::Element>::ARRAY,
                offset: std::mem::offset_of!($name, $field),
                doc: concat!($($field_doc, "\n"),+),
                codes: $crate::message::message!(@codes $($code)?),
            },)+];

            fn zeroed() -> Self {
                // SAFETY: only numbers; all bits zero is a valid value of each.
                unsafe { std::mem::zeroed() }
            }
            fn session(&self) -> u64 { self.session }
            fn incarnation(&self) -> u64 { self.incarnation }
            fn sequence(&self) -> u64 { self.sequence }
            fn time_ns(&self) -> u64 { self.time_ns }
            fn stamp(&mut self, session: u64, incarnation: u64, sequence: u64, time_ns: u64) {
                self.session = session;
                self.incarnation = incarnation;
                self.sequence = sequence;
                self.time_ns = time_ns;
            }
        }

        impl Default for $name {
            fn default() -> Self { <Self as $crate::Message>::zeroed() }
        }

        const _: () = {
            let mut end = 0;
            $(
                assert!(
                    std::mem::offset_of!($name, $field) == end,
                    concat!("padding before ", stringify!($name), ".", stringify!($field))
                );
                end += size_of::<$type>();
            )+
            assert!(size_of::<$name>() == end, concat!("tail padding in ", stringify!($name)));
            assert!(std::mem::offset_of!($name, session) == 0);
            assert!(std::mem::offset_of!($name, incarnation) == 8);
            assert!(std::mem::offset_of!($name, sequence) == 16);
            assert!(std::mem::offset_of!($name, time_ns) == 24);
        };
    };
    (@codes $code:ident) => { $crate::$code::CODES };
    (@codes) => { &[] };
}
pub(crate) use message;

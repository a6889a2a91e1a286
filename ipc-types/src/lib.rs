//! What crosses a process boundary, and nothing else: fixed-layout messages, the codes that they
//! carry, the tables of processes, topics and cards, the rule for loss, and the requests of the
//! command plane.
//!
//! Every message is `#[repr(C)]`, flat and padded by hand, so that the bytes in shared memory are
//! at the same time the body of a valid little-endian CDR message (behind a four-byte header). A
//! recording therefore holds a copy of those bytes, and readers that know `ros2msg` decode it with
//! no converter. The `messages!` macro asserts every offset at compile time and generates the
//! schema.
//!
//! Units are SI in every field and named in its doc comment: rad or m (the axis's declared unit),
//! N·m or N, s, V, Pa; times are ns of `CLOCK_MONOTONIC`. A positive master drives the slave
//! positive.
#![forbid(unsafe_op_in_unsafe_fn)]

mod card;
mod codes;
mod experiment_types;
mod message;
mod model_status;
mod model_types;
mod process;
pub mod program_flow;
mod pulse_source;
mod requests;
mod sequence;
mod timeouts;
mod topics;
mod types;
mod zeros;

pub use card::*;
pub use codes::*;
pub use experiment_types::*;
pub use message::{
    CDR_HEADER, Code, Field, Message, Primitive, TypeVisitor, Value, schema_comment,
};
pub use model_status::{ModelStatus, NewestModel};
pub use model_types::*;
pub use process::*;
pub use pulse_source::*;
pub use requests::*;
pub use sequence::{Arrival, SequenceTracker};
pub use timeouts::Timeouts;
pub use topics::*;
pub use types::*;
pub use zeros::Zeros;

/// Most axes that one rig has.
pub const AXES: usize = 3;
/// Elements of a matrix over the axes, row by row.
pub const MATRIX: usize = AXES * AXES;
/// Entries of a force field's table over position or velocity, for one axis.
pub const TABLE: usize = 17;
/// Entries of the tables of all axes, axis by axis.
pub const TABLES: usize = AXES * TABLE;
/// Most analog channels that one card has.
pub const ANALOG: usize = 16;
/// Bytes of an [`Event`]'s text.
pub const TEXT: usize = 120;
/// Most bars that a subject sees: one for the agonist muscles, one for the antagonists.
pub const BARS: usize = 2;
/// Height of a bar whose target is met; its field is twice as high.
pub const BAR_MIDDLE: f64 = 10.0;

/// Calls the visitor with the message type of that name in shared memory, for what knows a topic
/// from the table only; `None` where no message has the name.
pub fn visit_type<V: TypeVisitor>(name: &str, visitor: V) -> Option<V::Output> {
    types::visit(name, visitor)
        .or_else(|visitor| experiment_types::visit(name, visitor))
        .or_else(|visitor| model_types::visit(name, visitor))
        .ok()
}

//! A content hash of a text.

/// FNV-1a, 64 bit, of the text's bytes: names a rig file or a protocol in messages and recordings.
///
/// The same in every release and on every machine, which the standard library's hasher does not
/// promise. It tells texts apart and is not cryptographic.
pub const fn identity(text: &str) -> u64 {
    files::fnv1a(text.as_bytes())
}

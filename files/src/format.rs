//! Contents of a file with mark, version and checksum.
//!
//! The bytes: mark (4), version (2, little-endian), checksum (8, little-endian, [`fnv1a`] of what
//! follows), then a serde type in bincode (`config::standard()`). bincode is unmaintained
//! (RUSTSEC-2025-0141); the version allows another encoding.

use serde::Serialize;
use serde::de::DeserializeOwned;
use thiserror::Error;

const HEADER: usize = 4 + 2 + 8;
/// Largest memory that decoding may claim, and largest sensible file (bytes).
pub const LARGEST: usize = 16 << 20;

/// A kind of file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Format {
    /// What it holds, for errors: "learnt reference".
    pub what: &'static str,
    /// Its first bytes.
    pub mark: [u8; 4],
    /// Version that is written.
    pub version: u16,
}

/// Why contents cannot be read, or written.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum FormatError {
    /// Truncated, or another kind of file.
    #[error(
        "no {}: expected {HEADER} bytes that begin with \"{}\", found {found}",
        format.what, format.mark.escape_ascii()
    )]
    Mark {
        /// The kind that was expected.
        format: Format,
        /// What was found.
        found: String,
    },
    /// Written by another version.
    #[error("{} of version {found}, this build reads version {}", format.what, format.version)]
    Version {
        /// The kind and version that was expected.
        format: Format,
        /// Version in the file.
        found: u16,
    },
    /// Damaged.
    #[error("{what} is damaged: expected checksum {expected:016x}, found {found:016x}")]
    Checksum {
        /// What the file holds.
        what: &'static str,
        /// Checksum in the file.
        expected: u64,
        /// Checksum of its contents.
        found: u64,
    },
    /// Bytes that do not decode though their checksum is right, or a value that does not encode.
    #[error("{what} cannot be coded: {reason}")]
    Coding {
        /// What the file holds.
        what: &'static str,
        /// The encoder's or the decoder's reason.
        reason: String,
    },
}

impl Format {
    /// The bytes of a file with `value`.
    ///
    /// # Errors
    /// [`FormatError::Coding`].
    pub fn encode(&self, value: &impl Serialize) -> Result<Vec<u8>, FormatError> {
        let body = bincode::serde::encode_to_vec(value, bincode::config::standard())
            .map_err(|error| self.coding(error.to_string()))?;
        let (version, checksum) = (self.version.to_le_bytes(), fnv1a(&body).to_le_bytes());
        Ok([&self.mark[..], &version, &checksum, &body].concat())
    }

    /// The value in the bytes of a file of the present version.
    ///
    /// # Errors
    /// Each [`FormatError`]; a damaged file never yields a value.
    pub fn decode<T: DeserializeOwned>(&self, bytes: &[u8]) -> Result<T, FormatError> {
        let config = bincode::config::standard().with_limit::<LARGEST>();
        let body = self.body(bytes)?;
        let (value, read) = bincode::serde::decode_from_slice(body, config)
            .map_err(|error| self.coding(error.to_string()))?;
        if read != body.len() {
            return Err(self.coding(format!("{} bytes too many", body.len() - read)));
        }
        Ok(value)
    }

    /// The encoded value, mark, version and checksum verified.
    fn body<'a>(&self, bytes: &'a [u8]) -> Result<&'a [u8], FormatError> {
        let wrong = |found| FormatError::Mark { format: *self, found };
        let short = || wrong(format!("{} bytes", bytes.len()));
        let (mark, rest) = bytes.split_first_chunk::<4>().ok_or_else(short)?;
        if *mark != self.mark {
            return Err(wrong(format!("\"{}\"", mark.escape_ascii())));
        }
        let (version, rest) = rest.split_first_chunk::<2>().ok_or_else(short)?;
        let version = u16::from_le_bytes(*version);
        if version != self.version {
            return Err(FormatError::Version { format: *self, found: version });
        }
        let (checksum, body) = rest.split_first_chunk::<8>().ok_or_else(short)?;
        let (expected, found) = (u64::from_le_bytes(*checksum), fnv1a(body));
        if expected != found {
            return Err(FormatError::Checksum { what: self.what, expected, found });
        }
        Ok(body)
    }

    fn coding(&self, reason: String) -> FormatError {
        FormatError::Coding { what: self.what, reason }
    }
}

/// FNV-1a, 64 bit: a checksum against damage, and an identity that is the same in every release and
/// on every machine. It does not protect against a forger. Source: Fowler, Noll, Vo,
/// <http://www.isthe.com/chongo/tech/comp/fnv/>.
pub const fn fnv1a(bytes: &[u8]) -> u64 {
    let mut hash: u64 = 0xcbf2_9ce4_8422_2325;
    let mut at = 0;
    while at < bytes.len() {
        hash ^= bytes[at] as u64;
        hash = hash.wrapping_mul(0x0000_0100_0000_01b3);
        at += 1;
    }
    hash
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const FORMAT: Format = Format { what: "pair", mark: *b"FRXX", version: 2 };

    #[test]
    fn the_bytes_are_mark_version_checksum_and_bincode() {
        let body = b"\x07\x02ab";
        let bytes = [b"FRXX\x02\x00", &fnv1a(body).to_le_bytes()[..], body].concat();
        assert_eq!(FORMAT.encode(&(7_u64, "ab")).unwrap(), bytes);
        assert_eq!(FORMAT.decode::<(u64, String)>(&bytes).unwrap(), (7, "ab".to_owned()));
    }

    #[test]
    fn errors_say_what_was_expected_and_found() {
        let told = |bytes: &[u8]| FORMAT.decode::<u64>(bytes).unwrap_err().to_string();
        let expected = "no pair: expected 14 bytes that begin with \"FRXX\", found ";
        assert_eq!(told(b"FR"), format!("{expected}2 bytes"));
        assert_eq!(told(b"FRXX\x02\x001234567"), format!("{expected}13 bytes"));
        assert_eq!(told(b"FRYY\x02\x00\0\0\0\0\0\0\0\0"), format!("{expected}\"FRYY\""));
        assert_eq!(told(b"FRXX\x09\x00"), "pair of version 9, this build reads version 2");
        let sound = FORMAT.encode(&7_u64).unwrap();
        let mut damaged = sound.clone();
        damaged[14] ^= 1;
        assert!(told(&damaged).starts_with("pair is damaged: expected checksum "));
        let more = FORMAT.encode(&(7_u64, 7_u64)).unwrap();
        assert_eq!(told(&more), "pair cannot be coded: 1 bytes too many");
    }

    #[test]
    fn the_checksum_agrees_with_the_published_test_vectors() {
        assert_eq!(fnv1a(b""), 0xcbf2_9ce4_8422_2325);
        assert_eq!(fnv1a(b"a"), 0xaf63_dc4c_8601_ec8c);
        assert_eq!(fnv1a(b"foobar"), 0x8594_4171_f739_67e8);
    }

    proptest! {
        #[test]
        fn any_damage_is_an_error(at: prop::sample::Index, bit in 0..8_u8, cut: bool) {
            let mut bytes = FORMAT.encode(&(3_u32, "text", vec![0.5, 1e9])).unwrap();
            let at = at.index(bytes.len());
            if cut { bytes.truncate(at) } else { bytes[at] ^= 1 << bit }
            prop_assert!(FORMAT.decode::<(u32, String, Vec<f64>)>(&bytes).is_err());
        }
    }
}

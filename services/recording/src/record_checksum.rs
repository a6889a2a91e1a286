//! The checksum of a metadata record. MCAP guards metadata only by the checksum of all data, which
//! nobody computes who reads a rig file out of a recording of hours.

use std::collections::BTreeMap;

use crate::mcap_write::key;

/// CRC-32 (IEEE) of a record: of its name, and of each key and value but [`key::CHECKSUM`] in the
/// order of the keys, each behind its length in bytes (8, little-endian).
fn checksum(name: &str, content: &BTreeMap<String, String>) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    let mut take = |text: &str| {
        hasher.update(&(text.len() as u64).to_le_bytes());
        hasher.update(text.as_bytes());
    };
    take(name);
    for (key, value) in content.iter().filter(|(key, _)| *key != key::CHECKSUM) {
        take(key);
        take(value);
    }
    hasher.finalize()
}

/// The record with its checksum.
pub(crate) fn sealed(name: &str, content: BTreeMap<String, String>) -> mcap::records::Metadata {
    let mut metadata = content;
    let checksum = checksum(name, &metadata);
    metadata.insert(key::CHECKSUM.to_owned(), format!("{checksum:08x}"));
    mcap::records::Metadata { name: name.to_owned(), metadata }
}

/// Whether a record is as it was written; what was expected and found, where it is not. A record
/// without a checksum is that of an older build, unless it says otherwise.
pub(crate) fn verify(
    name: &str,
    content: &BTreeMap<String, String>,
) -> Result<(), (String, String)> {
    let expected = match content.get(key::CHECKSUM) {
        Some(expected) => expected.clone(),
        // The first layout had none; nor have records of other programs.
        None if content.get(key::FORMAT).is_none_or(|format| format == "1") => return Ok(()),
        None => "a checksum".to_owned(),
    };
    let found = format!("{:08x}", checksum(name, content));
    if expected == found { Ok(()) } else { Err((expected, found)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_is_as_it_was_written_or_is_found_to_differ() {
        let entries = [("format", "2"), ("rig_file", "[rates]\n"), ("rig", "hydrostatic")];
        let content = entries.map(|(key, value)| (key.to_owned(), value.to_owned())).into();
        let record = sealed("farreach", content);
        assert_eq!(verify("farreach", &record.metadata), Ok(()));
        assert!(verify("farreach.run", &record.metadata).is_err());
        // What moves from a key to its value, or from one entry to the next, is a difference too.
        let mut moved = record.metadata.clone();
        moved.remove("rig");
        moved.insert("righ".to_owned(), "ydrostatic".to_owned());
        assert!(verify("farreach", &moved).is_err());
        let mut without = record.metadata;
        without.remove(key::CHECKSUM);
        let (expected, _) = verify("farreach", &without).unwrap_err();
        assert_eq!(expected, "a checksum");
        without.insert("format".to_owned(), "1".to_owned());
        assert_eq!(verify("farreach", &without), Ok(()), "as older builds wrote it");
    }
}

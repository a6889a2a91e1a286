//! Fingerprint of a file: a hash of its contents, the same on every machine and in every release.
//!
//! FNV-1a of 128 bits (Fowler, Noll, Vo; RFC 9923). It distinguishes builds; it is not
//! cryptographic.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

const BASIS: u128 = 0x6c62_272e_07bb_0142_62b8_2175_6295_c58d;
const PRIME: u128 = 0x0000_0000_0100_0000_0000_0000_0000_013b;

/// The hash of a file's contents, 32 hexadecimal digits.
///
/// # Errors
/// What reading the file says.
pub fn of_file(path: &Path) -> io::Result<String> {
    let mut file = File::open(path)?;
    let mut hash = BASIS;
    let mut part = vec![0; 1 << 16];
    loop {
        let count = file.read(&mut part)?;
        if count == 0 {
            return Ok(format!("{hash:032x}"));
        }
        hash = mixed(hash, &part[..count]);
    }
}

fn mixed(hash: u128, bytes: &[u8]) -> u128 {
    bytes.iter().fold(hash, |hash, byte| (hash ^ u128::from(*byte)).wrapping_mul(PRIME))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Test vectors of its authors.
    #[test]
    fn the_hash_is_as_published() {
        for (text, hash) in [
            ("", 0x6c62_272e_07bb_0142_62b8_2175_6295_c58d),
            ("a", 0xd228_cb69_6f1a_8caf_7891_2b70_4e4a_8964),
            ("foobar", 0x343e_1662_793c_64bf_6f0d_3597_ba44_6f18),
        ] {
            assert_eq!(mixed(BASIS, text.as_bytes()), hash, "{text}");
        }
    }

    #[test]
    fn the_hash_covers_the_whole_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("program");
        let mut bytes = vec![7; 200_000];
        std::fs::write(&path, &bytes).unwrap();
        let before = of_file(&path).unwrap();
        assert_eq!(before, format!("{:032x}", mixed(BASIS, &bytes)));
        bytes[150_000] = 8;
        std::fs::write(&path, &bytes).unwrap();
        assert_ne!(of_file(&path).unwrap(), before);
    }
}

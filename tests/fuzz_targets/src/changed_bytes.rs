//! Changes of bytes that know nothing of their structure.

use crate::mutated::Numbers;

/// Bytes that are often the edge of something.
const EDGES: &[u8] = &[0, 1, 0x7f, 0x80, 0xfa, 0xfb, 0xfc, 0xfd, 0xfe, 0xff];

/// Bytes with one to three changes: set, turned, put in, taken out, doubled, taken from another.
pub(crate) fn changed(bytes: &[u8], other: &[u8], numbers: &mut Numbers) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    for _ in 0..=numbers.below(3) {
        let at = numbers.below(bytes.len() + 1);
        let length = (1 + numbers.below(16)).min(bytes.len() - at);
        match numbers.below(8) {
            0 | 1 if at < bytes.len() => bytes[at] = EDGES[numbers.below(EDGES.len())],
            2 if at < bytes.len() => bytes[at] ^= 1 << numbers.below(8),
            3 => {
                let edge = EDGES[numbers.below(EDGES.len())];
                bytes[at..at + length].fill(edge);
            }
            4 => drop(bytes.drain(at..at + length)),
            5 => {
                let part = bytes[at..at + length].to_vec();
                bytes.splice(at..at, part);
            }
            6 if !other.is_empty() => {
                let from = numbers.below(other.len());
                let until = (from + 1 + numbers.below(32)).min(other.len());
                bytes.splice(at..at + length, other[from..until].iter().copied());
            }
            _ => {
                let value = numbers.below(256) as u8;
                bytes.insert(at, value);
            }
        }
    }
    if numbers.below(20) == 0 {
        bytes.truncate(numbers.below(bytes.len() + 1));
    }
    bytes
}

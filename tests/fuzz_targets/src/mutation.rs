//! Changes of inputs that keep enough of their structure.

use files::fnv1a;

use crate::mutated::{Numbers, mutated};
use crate::{Form, Target, json, mcap_file};

/// Bytes in front of a sealed file's checksum, and its checksum.
const MARK: usize = 4 + 2;
const CHECKSUM: usize = 8;
/// Bytes that are often the edge of something.
const EDGES: &[u8] = &[0, 1, 0x7f, 0x80, 0xfa, 0xfb, 0xfc, 0xfd, 0xfe, 0xff];

pub(crate) fn broken(
    target: &Target,
    bytes: &[u8],
    others: &[Vec<u8>],
    numbers: &mut Numbers,
) -> Vec<u8> {
    let (front, body) = bytes.split_at(target.prefix.min(bytes.len()));
    let other = match others {
        [] => body,
        _ => others[numbers.below(others.len())].get(target.prefix..).unwrap_or_default(),
    };
    let body = match target.form {
        Form::Lines => lines(body, other, numbers),
        Form::Json => json::broken(body, other, numbers),
        Form::Bytes => changed(body, other, numbers),
        Form::Sealed => {
            let (head, inner) = body.split_at((MARK + CHECKSUM).min(body.len()));
            let other = other.get(MARK + CHECKSUM..).unwrap_or_default();
            let inner = changed(inner, other, numbers);
            let whole = [head, &inner].concat();
            if numbers.below(10) == 0 { changed(&whole, &[], numbers) } else { sealed(whole) }
        }
        Form::Mcap => mcap_file::broken(body, other, numbers),
    };
    let mut front = front.to_vec();
    if !front.is_empty() && numbers.below(4) == 0 {
        let at = numbers.below(front.len());
        front[at] = numbers.below(256) as u8;
    }
    let mut whole = [front, body].concat();
    whole.truncate(target.longest);
    whole
}

pub(crate) fn mended(target: &Target, bytes: Vec<u8>) -> Vec<u8> {
    let at = target.prefix.min(bytes.len());
    let mend = match target.form {
        Form::Sealed => sealed,
        Form::Mcap => mcap_file::mended,
        Form::Lines | Form::Json | Form::Bytes => return bytes,
    };
    let mut whole = bytes[..at].to_vec();
    whole.extend(mend(bytes[at..].to_vec()));
    whole
}

/// Text is broken as text; now and then as bytes.
fn lines(body: &[u8], other: &[u8], numbers: &mut Numbers) -> Vec<u8> {
    if numbers.below(8) == 0 {
        return changed(body, other, numbers);
    }
    let text = String::from_utf8_lossy(body);
    mutated(&text, &[&String::from_utf8_lossy(other)], numbers).into_bytes()
}

/// The checksum of a sealed file made right.
fn sealed(mut bytes: Vec<u8>) -> Vec<u8> {
    if bytes.len() >= MARK + CHECKSUM {
        let sum = fnv1a(&bytes[MARK + CHECKSUM..]).to_le_bytes();
        bytes[MARK..MARK + CHECKSUM].copy_from_slice(&sum);
    }
    bytes
}

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

//! Changes of inputs that keep enough of their structure.

use files::fnv1a;

use crate::changed_bytes::changed;
use crate::mutated::{Numbers, mutated};
use crate::{Form, Target, json, mcap_file};

/// Bytes in front of a sealed file's checksum, and its checksum.
const MARK: usize = 4 + 2;
const CHECKSUM: usize = 8;

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

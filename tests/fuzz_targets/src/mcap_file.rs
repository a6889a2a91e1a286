//! Changes of MCAP files record by record, and their checksums made right again.
//!
//! A file is its mark, records (opcode, length, body) and its mark. A chunk that is not compressed
//! has records of its own. <https://mcap.dev/spec>

use mcap::records::op;

use crate::changed_bytes::changed;
use crate::mutated::Numbers;

/// Opcode and length in front of a record (bytes).
const HEAD: usize = 1 + 8;
/// Times in front of a chunk's size and checksum (bytes).
const TIMES: usize = 8 + 8;
/// In front of a chunk's compression: times, size, checksum (bytes).
const CHUNK_HEAD: usize = TIMES + 8 + 4;

/// A record: opcode and body.
type Record = (u8, Vec<u8>);

/// The records of a file or chunk, and what is left behind the last whole one.
fn records(mut bytes: &[u8]) -> (Vec<Record>, &[u8]) {
    let mut found = Vec::new();
    while let Some((opcode, body, rest)) = first(bytes) {
        found.push((opcode, body.to_vec()));
        bytes = rest;
    }
    (found, bytes)
}

fn first(bytes: &[u8]) -> Option<(u8, &[u8], &[u8])> {
    let length = bytes.get(1..HEAD)?.try_into().map(u64::from_le_bytes).ok()?;
    let (body, rest) = bytes.get(HEAD..)?.split_at_checked(usize::try_from(length).ok()?)?;
    Some((bytes[0], body, rest))
}

fn put(bytes: &mut Vec<u8>, (opcode, body): &Record) {
    bytes.push(*opcode);
    bytes.extend((body.len() as u64).to_le_bytes());
    bytes.extend(body);
}

fn joined(records: &[Record]) -> Vec<u8> {
    let mut bytes = Vec::new();
    records.iter().for_each(|record| put(&mut bytes, record));
    bytes
}

/// The file without its marks; `None` where it does not begin with one.
fn inside(bytes: &[u8]) -> Option<&[u8]> {
    let inside = bytes.strip_prefix(mcap::MAGIC)?;
    Some(inside.strip_suffix(mcap::MAGIC).unwrap_or(inside))
}

/// The records of a chunk that is not compressed, with what is in front of them.
fn chunk(body: &[u8]) -> Option<(&[u8], &[u8])> {
    let front = CHUNK_HEAD + 4 + 8;
    let plain = body.get(CHUNK_HEAD..CHUNK_HEAD + 4)? == [0; 4];
    plain.then(|| body.split_at_checked(front)).flatten()
}

/// A file with one to three records changed; its checksums are right nine times in ten.
pub(crate) fn broken(body: &[u8], other: &[u8], numbers: &mut Numbers) -> Vec<u8> {
    let Some(within) = inside(body).filter(|_| numbers.below(10) > 0) else {
        return changed(body, other, numbers);
    };
    let (mut found, rest) = records(within);
    let others = inside(other).map(|other| records(other).0).unwrap_or_default();
    for _ in 0..=numbers.below(3) {
        change(&mut found, &others, numbers, true);
    }
    let mut bytes = mcap::MAGIC.to_vec();
    bytes.extend(joined(&found));
    bytes.extend(rest);
    if numbers.below(20) > 0 {
        bytes.extend(mcap::MAGIC);
    }
    if numbers.below(10) > 0 { mended(bytes) } else { bytes }
}

fn change(found: &mut Vec<Record>, others: &[Record], numbers: &mut Numbers, outside: bool) {
    if found.is_empty() {
        found.extend_from_slice(others);
        return;
    }
    let at = numbers.below(found.len());
    match numbers.below(9) {
        0 => drop(found.remove(at)),
        1 => found.insert(at, found[at].clone()),
        2 => {
            let other = numbers.below(found.len());
            found.swap(at, other);
        }
        3 if !others.is_empty() => found.insert(at, others[numbers.below(others.len())].clone()),
        4 => found[at].0 = numbers.below(17) as u8,
        _ => {
            let body = &mut found[at].1;
            match chunk(body).filter(|_| outside && numbers.below(8) > 0) {
                Some((front, within)) => {
                    let (mut inner, _) = records(within);
                    change(&mut inner, others, numbers, false);
                    *body = [front, &joined(&inner)].concat();
                }
                None => *body = changed(body, &[], numbers),
            }
        }
    }
}

/// Lengths and checksums of chunks that are not compressed, their places in the summary, and the
/// checksums of data and summary made right.
pub(crate) fn mended(bytes: Vec<u8>) -> Vec<u8> {
    let Some(within) = inside(&bytes) else { return bytes };
    let ends = bytes.len() == within.len() + 2 * mcap::MAGIC.len();
    let (mut found, rest) = records(within);
    let mut at = mcap::MAGIC.len() as u64;
    let mut chunks = Vec::new();
    for (opcode, body) in &mut found {
        if *opcode == op::CHUNK {
            mend_chunk(body);
            chunks.push((at, (HEAD + body.len()) as u64));
        }
        at += (HEAD + body.len()) as u64;
    }
    let indexes = found.iter_mut().filter(|(opcode, _)| *opcode == op::CHUNK_INDEX);
    for ((_, index), (start, length)) in indexes.zip(chunks) {
        if let Some(place) = index.get_mut(TIMES..TIMES + 16) {
            place.copy_from_slice(&[start.to_le_bytes(), length.to_le_bytes()].concat());
        }
    }
    let mut mended = mcap::MAGIC.to_vec();
    let mut summary = None;
    for (opcode, mut body) in found {
        if opcode == op::DATA_END && body.len() >= 4 {
            body[..4].copy_from_slice(&crc32fast::hash(&mended).to_le_bytes());
        }
        if opcode == op::FOOTER && body.len() == 20 {
            // Without a summary a reader looks into the chunks.
            let start = summary.filter(|start| *start < mended.len());
            body[..8].copy_from_slice(&(start.unwrap_or(0) as u64).to_le_bytes());
            let from = start.unwrap_or(mended.len());
            let head = [&[opcode][..], &20_u64.to_le_bytes(), &body[..16]].concat();
            let sum = crc32fast::hash(&[&mended[from..], &head].concat());
            body[16..].copy_from_slice(&sum.to_le_bytes());
        }
        put(&mut mended, &(opcode, body));
        if opcode == op::DATA_END {
            summary = Some(mended.len());
        }
    }
    mended.extend(rest);
    if ends {
        mended.extend(mcap::MAGIC);
    }
    mended
}

fn mend_chunk(body: &mut [u8]) {
    let Some((front, within)) = chunk(body) else { return };
    let (length, sum) = (within.len() as u64, crc32fast::hash(within));
    let at = front.len() - 8;
    body[TIMES..TIMES + 8].copy_from_slice(&length.to_le_bytes());
    body[TIMES + 8..CHUNK_HEAD].copy_from_slice(&sum.to_le_bytes());
    body[at..at + 8].copy_from_slice(&length.to_le_bytes());
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::recordings;

    #[test]
    fn a_sound_file_needs_no_mending() {
        for seed in recordings::plain_seeds() {
            let mended = mended(seed.clone());
            assert!(mended == seed, "{} bytes", seed.len());
        }
    }

    #[test]
    fn a_changed_file_is_mended() {
        let mut numbers = Numbers(1);
        let seeds = recordings::plain_seeds();
        let (mut whole, tries) = (0, 300);
        for at in 0..tries {
            let changed = broken(&seeds[at % seeds.len()], &seeds[0], &mut numbers);
            let file = crate::MemoryFile::new(&changed);
            let read = recording::mcap_read::Recording::open(file.path());
            whole += usize::from(read.is_ok_and(|read| read.damage.is_empty()));
        }
        assert!(whole > tries / 3, "{whole} of {tries} without damage");
    }
}

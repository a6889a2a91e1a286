//! The parts of a ring that have ended, and the removal of those that are too old.

use std::collections::VecDeque;
use std::fs;
use std::io::ErrorKind;

use crate::state::StartRequest;
use crate::writer_queue::RingParts;

/// A part that has ended.
#[derive(Clone, Copy, Debug)]
struct Ended {
    number: u32,
    /// When [ns, CLOCK_MONOTONIC].
    at_ns: u64,
    bytes: u64,
}

/// The parts of a ring, the oldest first; of another recording none. Only parts that this
/// recording made are ever removed.
#[derive(Debug, Default)]
pub(crate) struct Ring {
    ended: VecDeque<Ended>,
    removed: u64,
    not_removed: u64,
}

impl Ring {
    /// Those that a logger before this one left. The one that it did not end has ended by now.
    pub(crate) fn of(request: &StartRequest, now_ns: u64) -> Self {
        let found = |&(number, at_ns): &(u32, u64)| {
            let path = recording::part_path(&request.path, number);
            let bytes = path.metadata().ok()?.len();
            Some(Ended { number, at_ns: if at_ns == 0 { now_ns } else { at_ns }, bytes })
        };
        Self { ended: request.ring_parts.iter().filter_map(found).collect(), ..Self::default() }
    }

    /// Removes the parts that are too old by now, and notes in `request` which are there. Whether
    /// there were any.
    pub(crate) fn remove_old(&mut self, request: &mut StartRequest, at_ns: u64) -> bool {
        let Some(keep_ns) = request.split.keep_ns else { return false };
        let there = self.ended.len();
        // A part longer, so that all of the past is there while somebody takes hold of it.
        let keep_ns = keep_ns.saturating_add(request.split.every_ns.unwrap_or(0));
        while let Some(oldest) = self.ended.front()
            && oldest.at_ns.saturating_add(keep_ns) < at_ns
        {
            match fs::remove_file(recording::part_path(&request.path, oldest.number)) {
                Err(error) if error.kind() != ErrorKind::NotFound => self.not_removed += 1,
                _ => self.removed += 1,
            }
            self.ended.pop_front();
        }
        request.ring_parts = self.ended.iter().map(|part| (part.number, part.at_ns)).collect();
        self.ended.len() < there
    }

    /// A part has ended: removes those that are too old by now, and notes in `request` which are
    /// there.
    pub(crate) fn end_part(
        &mut self,
        request: &mut StartRequest,
        number: u32,
        at_ns: u64,
        bytes: u64,
    ) {
        if request.split.keep_ns.is_some() {
            self.ended.push_back(Ended { number, at_ns, bytes });
            self.remove_old(request, at_ns);
        }
    }

    /// What is there, with the present part.
    pub(crate) fn parts(&self, request: &StartRequest) -> RingParts {
        if request.split.keep_ns.is_none() {
            return RingParts::default();
        }
        let numbers = self.ended.iter().map(|part| part.number);
        RingParts {
            numbers: numbers.chain([request.part]).collect(),
            bytes: self.ended.iter().map(|part| part.bytes).sum(),
            removed: self.removed,
            not_removed: self.not_removed,
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use ipc_types::Split;

    use super::*;

    #[test]
    fn parts_go_once_they_are_too_old_and_no_others_do() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("ring.mcap");
        let split = Split { every_ns: Some(10), keep_ns: Some(30), every_bytes: None };
        let mut request = StartRequest { path, split, part: 1, ..StartRequest::default() };
        let part = |request: &StartRequest, number| recording::part_path(&request.path, number);
        // Somebody's: the number is passed over.
        fs::write(part(&request, 3), "somebody's data").unwrap();
        let mut ring = Ring::of(&request, 0);
        let numbers = [1, 2, 4, 5, 6, 7, 8, 9];
        for (number, at_ns) in numbers.into_iter().zip((10..).step_by(10)) {
            fs::write(part(&request, number), "four").unwrap();
            ring.end_part(&mut request, number, at_ns, 4);
            request.part = number + 1;
        }
        // At 80: those that ended before 40.
        assert_eq!(request.ring_parts, [(5, 40), (6, 50), (7, 60), (8, 70), (9, 80)]);
        let found = ring.parts(&request);
        assert_eq!(found.numbers, [5, 6, 7, 8, 9, 10]);
        assert_eq!((found.bytes, found.removed, found.not_removed), (20, 3, 0));
        for number in [1, 2, 4] {
            assert!(!part(&request, number).exists(), "{number}");
        }
        for number in [3, 5, 6, 7, 8, 9] {
            assert!(part(&request, number).exists(), "{number}");
        }

        // Before there is another part, and not twice.
        assert!(ring.remove_old(&mut request, 81));
        assert_eq!(request.ring_parts, [(6, 50), (7, 60), (8, 70), (9, 80)]);
        assert!(!ring.remove_old(&mut request, 90));
        assert!(!part(&request, 5).exists() && part(&request, 6).exists());
        assert_eq!(ring.parts(&request).removed, 4);
    }

    #[test]
    fn a_logger_that_takes_over_knows_the_parts_and_when_they_ended() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("ring.mcap");
        let split = Split { every_ns: Some(10), keep_ns: Some(30), every_bytes: None };
        let part = |number| recording::part_path(&path, number);
        for number in [1, 2, 3, 4, 5] {
            fs::write(part(number), "four").unwrap();
        }
        // Somebody removed one, and the third is not of the ring.
        fs::remove_file(part(2)).unwrap();
        let ring_parts = vec![(1, 10), (2, 20), (4, 40)];
        let before =
            StartRequest { path: path.clone(), split, part: 5, ring_parts, ..Default::default() };
        let mut next = before.next_part(Default::default());
        assert_eq!(next.ring_parts, [(1, 10), (2, 20), (4, 40), (5, 0)]);
        let mut ring = Ring::of(&next, 60);
        assert_eq!(ring.parts(&next).numbers, [1, 4, 5, 6]);
        assert!(ring.remove_old(&mut next, 60));
        assert_eq!(next.ring_parts, [(4, 40), (5, 60)]);
        // Again and again, sooner than a part ends: the ring does not grow.
        let mut next = next.next_part(Default::default());
        let mut ring = Ring::of(&next, 90);
        assert!(ring.remove_old(&mut next, 90));
        assert_eq!(next.ring_parts, [(5, 60)], "the sixth was never made");
        assert!([1, 2, 4].iter().all(|number| !part(*number).exists()));
        assert!(part(3).exists() && part(5).exists());
    }

    #[test]
    fn a_part_that_was_created_while_another_was_ended_belongs_to_the_ring() {
        let split = Split { every_ns: Some(10), keep_ns: Some(30), every_bytes: None };
        let (ring_parts, part) = (vec![(1, 10)], 2);
        let killed = StartRequest { split, part, ring_parts, created: 4, ..Default::default() };
        let next = killed.clone().next_part(Default::default());
        assert_eq!((next.part, next.created), (5, 0));
        assert_eq!(next.ring_parts, [(1, 10), (2, 0), (4, 0)], "the third is somebody's");
        let split = Split { keep_ns: None, ..split };
        let next = StartRequest { split, ..killed }.next_part(Default::default());
        assert_eq!((next.part, next.ring_parts.len()), (5, 1), "no ring");
    }

    #[test]
    fn what_cannot_be_removed_is_counted() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("ring.mcap");
        let split = Split { every_ns: Some(1), keep_ns: Some(1), every_bytes: None };
        let mut request = StartRequest { path, split, part: 1, ..StartRequest::default() };
        let mut ring = Ring::of(&request, 0);
        // No file.
        fs::create_dir(recording::part_path(&request.path, 1)).unwrap();
        ring.end_part(&mut request, 1, 1, 0);
        ring.end_part(&mut request, 2, 10, 0);
        let found = ring.parts(&request);
        assert_eq!((found.removed, found.not_removed), (0, 1));
    }

    #[test]
    fn another_recording_keeps_its_parts() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        fs::write(&path, "kept").unwrap();
        let split = Split { every_ns: Some(1), ..Split::default() };
        let mut request = StartRequest { path, split, part: 1, ..StartRequest::default() };
        let mut ring = Ring::of(&request, 0);
        ring.end_part(&mut request, 1, 1, 4);
        ring.end_part(&mut request, 2, u64::MAX, 4);
        assert!(request.path.exists() && request.ring_parts.is_empty());
        assert_eq!(ring.parts(&request), RingParts::default());
    }
}

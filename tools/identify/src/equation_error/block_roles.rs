//! Roles of the rows: fit, select, report.

use rand::{Rng as _, SeedableRng as _};
use rand_xoshiro::SplitMix64;

/// What rows are used for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Role {
    /// Parameters are fitted on them.
    Fit,
    /// Effects are selected on them.
    Select,
    /// Errors are reported on them; they are used once, at the end.
    Report,
}

/// Contiguous rows of one record with one role.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Block {
    /// Index of the record.
    pub record: usize,
    /// Rows.
    pub rows: std::ops::Range<usize>,
    /// Their role.
    pub role: Role,
}

/// Splits one record into contiguous blocks of `length` rows with `guard` rows left out in between,
/// so that the low-pass carries nothing from one block into the next. Of every four successive
/// blocks two fit, one selects and one reports, in random order: the roles are spread over the
/// record and cannot coincide with a period of the motion.
pub fn one_record(
    record: usize,
    rows: usize,
    length: usize,
    guard: usize,
    seed: u64,
) -> Vec<Block> {
    let mut random = SplitMix64::seed_from_u64(seed);
    let mut blocks = Vec::new();
    let mut start = 0;
    let mut roles = Vec::new();
    while start + length <= rows {
        if roles.is_empty() {
            roles = vec![Role::Fit, Role::Fit, Role::Select, Role::Report];
            for i in (1..roles.len()).rev() {
                roles.swap(i, (random.next_u64() % (i as u64 + 1)) as usize);
            }
        }
        if let Some(role) = roles.pop() {
            blocks.push(Block { record, rows: start..start + length, role });
        }
        start += length + guard;
    }
    blocks
}

/// A whole record in one role, cut into blocks of about `length` rows (gains are validated block by
/// block).
pub fn whole_record(record: usize, rows: usize, length: usize, role: Role) -> Vec<Block> {
    let count = (rows / length.max(1)).max(1);
    (0..count)
        .map(|i| Block { record, rows: i * rows / count..(i + 1) * rows / count, role })
        .collect()
}

/// Default roles of `n` whole records: the last quarter reports, the quarter before it selects
/// (each rounded down, but at least one record), the others fit. `None` for fewer than three
/// records.
pub fn roles(n: usize) -> Option<Vec<Role>> {
    if n < 3 {
        return None;
    }
    let quarter = (n / 4).max(1);
    Some(
        (0..n)
            .map(|i| match i {
                i if i >= n - quarter => Role::Report,
                i if i >= n - 2 * quarter => Role::Select,
                _ => Role::Fit,
            })
            .collect(),
    )
}

/// Blocks of one role.
pub fn blocks_of_role(blocks: &[Block], role: Role) -> Vec<Block> {
    blocks.iter().filter(|b| b.role == role).cloned().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_keep_their_distance_and_all_roles_are_there() {
        for seed in 0..20 {
            let blocks = one_record(0, 5000, 120, 20, seed);
            for pair in blocks.windows(2) {
                assert_eq!(pair[1].rows.start - pair[0].rows.end, 20);
            }
            let count = |role| blocks.iter().filter(|b| b.role == role).count();
            assert!(
                count(Role::Fit) >= 2 * count(Role::Select) - 2 && count(Role::Select) >= 8,
                "seed {seed}"
            );
            assert!(count(Role::Report) >= 8);
        }
        assert_ne!(one_record(0, 5000, 120, 20, 1), one_record(0, 5000, 120, 20, 2));
    }

    #[test]
    fn a_record_in_one_role_is_covered_without_holes() {
        let blocks = whole_record(3, 1001, 100, Role::Select);
        assert_eq!((blocks[0].rows.start, blocks[blocks.len() - 1].rows.end), (0, 1001));
        assert!(blocks.windows(2).all(|p| p[0].rows.end == p[1].rows.start));
    }

    #[test]
    fn three_records_or_more_get_whole_roles() {
        assert_eq!(roles(2), None);
        assert_eq!(roles(3), Some(vec![Role::Fit, Role::Select, Role::Report]));
        assert_eq!(roles(8).map(|r| r.iter().filter(|r| **r == Role::Report).count()), Some(2));
    }
}

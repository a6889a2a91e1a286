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

/// Fewest blocks of one record whose roles are drawn in turns of four.
pub const MANY: usize = 12;
/// With fewer blocks, so many blocks have each of the roles that do not fit.
pub const FEW: usize = 3;

/// How one record is cut into contiguous blocks, with rows left out in between so that the low-pass
/// carries nothing from one block into the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cut {
    /// Index of the record.
    pub record: usize,
    /// Number of its rows.
    pub rows: usize,
    /// Rows of a block.
    pub length: usize,
    /// Rows left out between two blocks.
    pub guard: usize,
}

impl Cut {
    /// Number of blocks.
    pub fn count(&self) -> usize {
        (self.rows + self.guard) / (self.length + self.guard)
    }

    /// The blocks with roles drawn by [`draw`].
    pub fn blocks(&self, held_out: &[Role], seed: u64) -> Vec<Block> {
        let start = |block: usize| block * (self.length + self.guard);
        draw(self.count(), held_out, seed)
            .into_iter()
            .enumerate()
            .map(|(block, role)| Block {
                record: self.record,
                rows: start(block)..start(block) + self.length,
                role,
            })
            .collect()
    }
}

/// Roles of `count` successive blocks in random order, spread over the record so that they cannot
/// coincide with a period of the motion: of every four successive blocks two fit, one selects and
/// one reports. With fewer than [`MANY`] blocks each third of the record has one block of each of
/// the roles `held_out`; the others fit.
pub fn draw(count: usize, held_out: &[Role], seed: u64) -> Vec<Role> {
    let mut random = SplitMix64::seed_from_u64(seed);
    let mut roles = Vec::new();
    let mut turn = |mut turn: Vec<Role>| {
        for i in (1..turn.len()).rev() {
            turn.swap(i, (random.next_u64() % (i as u64 + 1)) as usize);
        }
        turn.reverse();
        turn
    };
    if count < MANY {
        for third in 0..FEW {
            let blocks = (third + 1) * count / FEW - third * count / FEW;
            let fits = blocks.saturating_sub(held_out.len());
            let held_out = held_out.iter().copied();
            roles.extend(turn(held_out.chain(vec![Role::Fit; fits]).collect()));
        }
    }
    while roles.len() < count {
        roles.extend(turn(vec![Role::Fit, Role::Fit, Role::Select, Role::Report]));
    }
    roles.truncate(count);
    roles
}

/// A whole record in one role, cut into blocks of about `length` rows (gains are validated block by
/// block).
pub fn whole_record(record: usize, rows: usize, length: usize, role: Role) -> Vec<Block> {
    let count = (rows / length.max(1)).max(1);
    (0..count)
        .map(|i| Block { record, rows: i * rows / count..(i + 1) * rows / count, role })
        .collect()
}

/// Default roles of `n` whole records: the last `held_out` report, as many before them select, the
/// others fit. `None` where no record is left to fit.
pub fn roles(n: usize, held_out: usize) -> Option<Vec<Role>> {
    let role = |i: usize| match i {
        i if i >= n - held_out => Role::Report,
        i if i >= n - 2 * held_out => Role::Select,
        _ => Role::Fit,
    };
    (2 * held_out < n).then(|| (0..n).map(role).collect())
}

/// Blocks of one role.
pub fn blocks_of_role(blocks: &[Block], role: Role) -> Vec<Block> {
    blocks.iter().filter(|b| b.role == role).cloned().collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn cut(rows: usize) -> Cut {
        Cut { record: 0, rows, length: 120, guard: 20 }
    }

    fn count(blocks: &[Block], role: Role) -> usize {
        blocks.iter().filter(|b| b.role == role).count()
    }

    #[test]
    fn blocks_keep_their_distance_and_all_roles_are_there() {
        let blocks = |seed| cut(5000).blocks(&[Role::Select, Role::Report], seed);
        for seed in 0..20 {
            let blocks = blocks(seed);
            for pair in blocks.windows(2) {
                assert_eq!(pair[1].rows.start - pair[0].rows.end, 20);
            }
            assert!(blocks.last().unwrap().rows.end <= 5000);
            let count = |role| count(&blocks, role);
            assert!(
                count(Role::Fit) >= 2 * count(Role::Select) - 2 && count(Role::Select) >= 8,
                "seed {seed}"
            );
            assert!(count(Role::Report) >= 8);
        }
        assert_ne!(blocks(1), blocks(2));
    }

    #[test]
    fn few_blocks_have_three_of_each_role_one_in_each_third() {
        for (blocks, seed) in (9..MANY).flat_map(|blocks| (0..20).map(move |seed| (blocks, seed))) {
            let cut = cut(blocks * 140 - 20);
            assert_eq!(cut.count(), blocks);
            let cut_blocks = cut.blocks(&[Role::Select, Role::Report], seed);
            let count = |role| count(&cut_blocks, role);
            assert_eq!((count(Role::Select), count(Role::Report)), (FEW, FEW));
            assert_eq!(count(Role::Fit), blocks - 2 * FEW);
            let first = cut_blocks.iter().position(|b| b.role == Role::Select).unwrap();
            let last = cut_blocks.iter().rposition(|b| b.role == Role::Select).unwrap();
            assert!(first < 3 && last >= blocks - 4, "{cut_blocks:?}");
        }
        // Where nothing reports.
        let blocks = cut(6 * 140).blocks(&[Role::Select], 1);
        assert_eq!((count(&blocks, Role::Select), count(&blocks, Role::Fit)), (3, 3));
    }

    #[test]
    fn a_record_in_one_role_is_covered_without_holes() {
        let blocks = whole_record(3, 1001, 100, Role::Select);
        assert_eq!((blocks[0].rows.start, blocks[blocks.len() - 1].rows.end), (0, 1001));
        assert!(blocks.windows(2).all(|p| p[0].rows.end == p[1].rows.start));
    }

    #[test]
    fn three_records_or_more_get_whole_roles() {
        assert_eq!(roles(2, 1), None);
        assert_eq!(roles(3, 1), Some(vec![Role::Fit, Role::Select, Role::Report]));
        assert_eq!(roles(8, 2).map(|r| r.iter().filter(|r| **r == Role::Report).count()), Some(2));
    }
}

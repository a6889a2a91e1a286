//! Assigns roles to the rows of a model with one measured channel: to whole records if there are
//! enough, else to blocks of one record.

use std::ops::Range;

use crate::equation_error::block_roles::{self, Block, Cut, FEW, MANY, Role};
use crate::equation_error::model::RegressionModel;
use crate::equation_error::signals::ForceBalance;
use crate::error::{IdentifyError, Result};
use crate::input::Series;
use crate::prediction_error::record::rms;
use crate::selection::predictor::Predictor;

/// Blocks last at least this long where the record allows it (s).
const BLOCK_S: f64 = 0.4;
/// Shortest block, in periods of the cut-off: the residuals of such blocks are nearly independent.
const BLOCK_PERIODS: f64 = 16.0;
/// Rows left out between blocks of one record, in periods of the cut-off.
const GUARD_PERIODS: f64 = 4.0;
/// A record is cut into about this many blocks.
const BLOCKS: f64 = 40.0;
/// Fewest blocks of a record that fits, selects and reports: so many of each role.
const FEWEST_BLOCKS: usize = 3 * FEW;
/// The same of one that fits and selects.
const FEWEST_BLOCKS_OF_TWO: usize = 2 * FEW;
/// Fewest blocks of a record whose output is simulated, each of [`BLOCK_S`] at least: on less, one
/// shape of a spring is taken for another.
const FEWEST_SIMULATED: usize = MANY;

/// A block in which position and velocity stay below this share of the travel and of the rms
/// velocity of all records does not move.
const STILL: f64 = 0.05;

/// Assigns roles. Records that do not move are left out; of one record, blocks that do not move
/// are, where a role would otherwise have fewer than three that do.
///
/// # Errors
/// If the records are too short for three moving blocks that select: one or two give no standard
/// error of a mean, and anything would pass.
pub(super) fn assign_roles(
    predictor: &Predictor<'_>,
    records: &[Series],
    seed: u64,
    notes: &mut Vec<String>,
) -> Result<Vec<Block>> {
    let regression = predictor.regression();
    let movement = Movement::of(predictor);
    let mut moving: Vec<usize> =
        (0..records.len()).filter(|record| movement.is_in_record(*record)).collect();
    if moving.is_empty() {
        moving = (0..records.len()).collect();
    }
    let left_out = (0..records.len()).filter(|record| !moving.contains(record));
    notes.extend(
        left_out.map(|record| format!("{} is left out: nothing moves", records[record].file)),
    );
    let fixed = records.iter().all(|record| record.role.is_some());
    if fixed {
        let roles: Vec<_> =
            moving.iter().filter_map(|record| Some((*record, records[*record].role?))).collect();
        return whole_records(&movement, &roles);
    }
    match moving[..] {
        [] => Ok(Vec::new()),
        [one] => in_blocks(&movement, one, &[Role::Select, Role::Report], seed, notes),
        [first, second] => {
            // The second reports as a whole; the first fits and selects.
            let mut blocks = in_blocks(&movement, first, &[Role::Select], seed, notes)?;
            let report = &regression.balances[second];
            blocks.extend(block_roles::whole_record(
                second,
                report.rows(),
                movement.lengths(second).preferred,
                Role::Report,
            ));
            Ok(blocks)
        }
        _ => {
            // A quarter reports and a quarter selects, or more where these are too short.
            let n = moving.len();
            let mut shared_out = ((n / 4).max(1)..n)
                .map_while(|held_out| block_roles::roles(n, held_out))
                .map(|roles| {
                    let roles: Vec<_> = moving.iter().copied().zip(roles).collect();
                    whole_records(&movement, &roles)
                });
            let first = shared_out.next().unwrap_or_else(|| Ok(Vec::new()));
            first.or_else(|error| shared_out.find_map(Result::ok).ok_or(error))
        }
    }
}

/// Where the records move.
struct Movement<'a> {
    regression: &'a RegressionModel,
    /// Whether the output is simulated.
    simulated: bool,
    /// Position and velocity of each record, row by row.
    rows: Vec<[Vec<f64>; 2]>,
}

impl<'a> Movement<'a> {
    fn of(predictor: &'a Predictor<'_>) -> Self {
        let regression = predictor.regression();
        let simulated = matches!(predictor, Predictor::OutputError(_));
        let rows = |balance: &ForceBalance| {
            let signals = &balance.signals;
            [&signals.position, &signals.velocity].map(|full| signals.rows(full))
        };
        Self { regression, simulated, rows: regression.balances.iter().map(rows).collect() }
    }

    fn balance(&self, record: usize) -> &ForceBalance {
        &self.regression.balances[record]
    }

    fn is_in(&self, record: usize, rows: Range<usize>) -> bool {
        let axis = &self.regression.axis;
        let [position, velocity] = &self.rows[record];
        let [position, velocity] =
            [position, velocity].map(|full| full.get(rows.clone()).unwrap_or_default());
        let (low, high) = position
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)));
        high - low >= STILL * axis.travel()
            || rms(velocity.iter().copied()) >= STILL * axis.velocity_rms
    }

    fn is_in_record(&self, record: usize) -> bool {
        self.is_in(record, 0..self.balance(record).rows())
    }

    fn is_in_block(&self, block: &Block) -> bool {
        self.is_in(block.record, block.rows.clone())
    }

    fn lengths(&self, record: usize) -> Lengths {
        let balance = self.balance(record);
        let rows = |seconds: f64| (seconds / balance.row_step()).ceil() as usize;
        let seconds = balance.rows() as f64 * balance.row_step();
        let shortest = self.shortest_s(balance);
        Lengths {
            preferred: rows((seconds / BLOCKS).max(BLOCK_S.max(shortest))),
            shortest: rows(shortest),
            guard: rows(GUARD_PERIODS / balance.cut_off),
        }
    }

    /// Shortest block of a record (s).
    fn shortest_s(&self, balance: &ForceBalance) -> f64 {
        let periods = BLOCK_PERIODS / balance.cut_off;
        if self.simulated { periods.max(BLOCK_S) } else { periods }
    }

    /// Number of blocks of a role that move.
    fn count(&self, blocks: &[Block], role: Role) -> usize {
        blocks.iter().filter(|block| block.role == role && self.is_in_block(block)).count()
    }
}

/// Lengths of the blocks of a record (rows).
struct Lengths {
    preferred: usize,
    shortest: usize,
    guard: usize,
}

/// Whole records with these roles, cut into blocks on which gains are validated.
fn whole_records(movement: &Movement<'_>, roles: &[(usize, Role)]) -> Result<Vec<Block>> {
    let blocks: Vec<Block> = roles
        .iter()
        .flat_map(|(record, role)| {
            let balance = movement.balance(*record);
            let Lengths { preferred, shortest, .. } = movement.lengths(*record);
            let rows = balance.rows();
            let length = if rows / preferred < FEW { shortest } else { preferred };
            block_roles::whole_record(*record, rows, length, *role)
        })
        .collect();
    match blocks.iter().find(|block| block.role == Role::Select) {
        Some(first) if movement.count(&blocks, Role::Select) < FEW => {
            Err(too_short_to_select(movement, movement.balance(first.record)))
        }
        _ => Ok(blocks),
    }
}

/// One record, cut into blocks with roles.
fn in_blocks(
    movement: &Movement<'_>,
    record: usize,
    held_out: &[Role],
    seed: u64,
    notes: &mut Vec<String>,
) -> Result<Vec<Block>> {
    let balance = movement.balance(record);
    let Lengths { preferred, shortest, guard } = movement.lengths(record);
    let rows = balance.rows();
    // The longest blocks of which there are many.
    let of_many = ((rows + guard) / MANY).saturating_sub(guard);
    let length = preferred.min(of_many).max(shortest);
    let mut cut = Cut { record, rows, length, guard };
    let least = match held_out.len() {
        _ if movement.simulated => FEWEST_SIMULATED,
        1 => FEWEST_BLOCKS_OF_TWO,
        _ => FEWEST_BLOCKS,
    };
    if cut.count() < least {
        return Err(too_short_to_cut(movement, balance, least));
    }
    let seed = seed.wrapping_add(record as u64);
    let mut blocks = cut.blocks(held_out, seed);
    if blocks.iter().filter(|block| movement.is_in_block(block)).count() < least {
        // Little of a long record moves.
        cut.length = shortest;
        blocks = cut.blocks(held_out, seed);
    }
    let moves = |role| movement.count(&blocks, role) >= FEW;
    if ![Role::Fit].iter().chain(held_out).all(|role| moves(*role)) {
        let of_all = blocks.len();
        blocks.retain(|block| movement.is_in_block(block));
        if blocks.len() < least {
            let found = format!("{} of {of_all} stretches move", blocks.len());
            let expected = format!("{} that move", needed(movement, least, balance));
            return Err(IdentifyError::short(&balance.name, found, expected));
        }
        let roles = block_roles::draw(blocks.len(), held_out, seed);
        blocks.iter_mut().zip(roles).for_each(|(block, role)| block.role = role);
        notes.push(format!(
            "{}: {} of {of_all} stretches are left out: nothing moves in them",
            balance.name,
            of_all - blocks.len()
        ));
    }
    // In turns of four one block reports: it selects, where another record reports.
    let spare = |block: &&mut Block| !held_out.contains(&block.role) && block.role != Role::Fit;
    blocks.iter_mut().filter(spare).for_each(|block| block.role = Role::Select);
    Ok(blocks)
}

/// The blocks that are needed.
fn needed(movement: &Movement<'_>, blocks: usize, balance: &ForceBalance) -> String {
    let (seconds, cut_off) = (movement.shortest_s(balance), balance.cut_off);
    let periods = seconds * cut_off;
    format!("{blocks} stretches of {periods:.0} periods of the cut-off ({cut_off:.4} Hz)")
}

/// Seconds of a record that leave so many blocks with `guards` between them, beside the edges that
/// are cut off.
fn seconds(movement: &Movement<'_>, blocks: usize, guards: usize, balance: &ForceBalance) -> f64 {
    let signals = &balance.signals;
    let recorded = signals.time[signals.time.len() - 1] - signals.time[0];
    let edges = recorded - balance.rows() as f64 * balance.row_step();
    let blocks_s = blocks as f64 * movement.shortest_s(balance);
    edges + blocks_s + guards as f64 * GUARD_PERIODS / balance.cut_off
}

/// Rounded up to a tenth.
fn tenths(seconds: f64) -> f64 {
    (10.0 * seconds).ceil() / 10.0
}

fn too_short_to_select(movement: &Movement<'_>, balance: &ForceBalance) -> IdentifyError {
    let found = format!("{:.2} s to select on", balance.rows() as f64 * balance.row_step());
    let expected = format!(
        "{}: a record of {:.1} s, or more records that select",
        needed(movement, FEW, balance),
        tenths(seconds(movement, FEW, 0, balance))
    );
    IdentifyError::short(&balance.name, found, expected)
}

fn too_short_to_cut(
    movement: &Movement<'_>,
    balance: &ForceBalance,
    least: usize,
) -> IdentifyError {
    let signals = &balance.signals;
    let recorded = signals.time[signals.time.len() - 1] - signals.time[0];
    let found = format!("{recorded:.2} s ({} rows)", (recorded / balance.sampling).round() + 1.0);
    let expected = format!(
        "{:.1} s for {} that fit, select and report, or three records of {:.1} s each",
        tenths(seconds(movement, least, least - 1, balance)),
        needed(movement, least, balance),
        tenths(seconds(movement, FEW, 0, balance))
    );
    IdentifyError::short(&balance.name, found, expected)
}

//! Assigns roles to the rows of a model with one measured channel: to whole records if there are
//! enough, else to blocks of one record.

use crate::equation_error::block_roles::{self, Block, Cut, FEW, MANY, Role};
use crate::equation_error::model::RegressionModel;
use crate::equation_error::signals::ForceBalance;
use crate::error::{IdentifyError, Result};
use crate::input::Series;

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

/// Assigns roles.
///
/// # Errors
/// If the records are too short for three blocks that select: one or two give no standard error of
/// a mean, and anything would pass.
pub(super) fn assign_roles(
    regression: &RegressionModel,
    records: &[Series],
    seed: u64,
) -> Result<Vec<Block>> {
    let balances = &regression.balances;
    if records.iter().all(|record| record.role.is_some()) {
        let roles: Vec<Role> = records.iter().filter_map(|record| record.role).collect();
        return whole_records(balances, &roles);
    }
    let n = balances.len();
    match n {
        0 => Ok(Vec::new()),
        1 => in_blocks(balances, 0, &[Role::Select, Role::Report], seed),
        2 => {
            // The second reports as a whole; the first fits and selects.
            let mut blocks = in_blocks(balances, 0, &[Role::Select], seed)?;
            let report = &balances[1];
            blocks.extend(block_roles::whole_record(
                1,
                report.rows(),
                lengths(report).preferred,
                Role::Report,
            ));
            Ok(blocks)
        }
        _ => {
            // A quarter reports and a quarter selects, or more where these are too short.
            let shares = (n / 4).max(1)..n;
            let mut shared_out = shares
                .map_while(|held_out| block_roles::roles(n, held_out))
                .map(|roles| whole_records(balances, &roles));
            let first = shared_out.next().unwrap_or_else(|| Ok(Vec::new()));
            first.or_else(|error| shared_out.find_map(Result::ok).ok_or(error))
        }
    }
}

/// Lengths of the blocks of a record (rows).
struct Lengths {
    preferred: usize,
    shortest: usize,
    guard: usize,
}

fn lengths(balance: &ForceBalance) -> Lengths {
    let rows = |seconds: f64| (seconds / balance.row_step()).ceil() as usize;
    let seconds = balance.rows() as f64 * balance.row_step();
    let shortest = BLOCK_PERIODS / balance.cut_off;
    Lengths {
        preferred: rows((seconds / BLOCKS).max(BLOCK_S.max(shortest))),
        shortest: rows(shortest),
        guard: rows(GUARD_PERIODS / balance.cut_off),
    }
}

/// Whole records with these roles, cut into blocks on which gains are validated.
fn whole_records(balances: &[ForceBalance], roles: &[Role]) -> Result<Vec<Block>> {
    let blocks: Vec<Block> = roles
        .iter()
        .enumerate()
        .flat_map(|(record, role)| {
            let balance = &balances[record];
            let Lengths { preferred, shortest, .. } = lengths(balance);
            let rows = balance.rows();
            let length = if rows / preferred < FEW { shortest } else { preferred };
            block_roles::whole_record(record, rows, length, *role)
        })
        .collect();
    let selecting = || blocks.iter().filter(|block| block.role == Role::Select);
    match selecting().next() {
        Some(first) if selecting().count() < FEW => {
            Err(too_short_to_select(&balances[first.record]))
        }
        _ => Ok(blocks),
    }
}

/// One record, cut into blocks with roles.
fn in_blocks(
    balances: &[ForceBalance],
    record: usize,
    held_out: &[Role],
    seed: u64,
) -> Result<Vec<Block>> {
    let balance = &balances[record];
    let Lengths { preferred, shortest, guard } = lengths(balance);
    let rows = balance.rows();
    // The longest blocks of which there are many.
    let of_many = ((rows + guard) / MANY).saturating_sub(guard);
    let length = preferred.min(of_many).max(shortest);
    let cut = Cut { record, rows, length, guard };
    let least = if held_out.len() > 1 { FEWEST_BLOCKS } else { FEWEST_BLOCKS_OF_TWO };
    if cut.count() < least {
        return Err(too_short_to_cut(balance, least));
    }
    let seed = seed.wrapping_add(record as u64);
    let mut blocks = cut.blocks(held_out, seed);
    // In turns of four one block reports: it selects, where another record reports.
    let spare = |block: &&mut Block| !held_out.contains(&block.role) && block.role != Role::Fit;
    blocks.iter_mut().filter(spare).for_each(|block| block.role = Role::Select);
    Ok(blocks)
}

/// The blocks that are needed.
fn needed(blocks: usize, balance: &ForceBalance) -> String {
    let cut_off = balance.cut_off;
    format!("{blocks} stretches of {BLOCK_PERIODS} periods of the cut-off ({cut_off:.4} Hz)")
}

/// Seconds of a record that leave so many blocks with `guards` between them, beside the edges that
/// are cut off.
fn seconds(blocks: usize, guards: usize, balance: &ForceBalance) -> f64 {
    let signals = &balance.signals;
    let recorded = signals.time[signals.time.len() - 1] - signals.time[0];
    let edges = recorded - balance.rows() as f64 * balance.row_step();
    let periods = blocks as f64 * BLOCK_PERIODS + guards as f64 * GUARD_PERIODS;
    edges + periods / balance.cut_off
}

/// Rounded up to a tenth.
fn tenths(seconds: f64) -> f64 {
    (10.0 * seconds).ceil() / 10.0
}

fn too_short_to_select(balance: &ForceBalance) -> IdentifyError {
    let found = format!("{:.2} s to select on", balance.rows() as f64 * balance.row_step());
    let expected = format!(
        "{}: a record of {:.1} s, or more records that select",
        needed(FEW, balance),
        tenths(seconds(FEW, 0, balance))
    );
    IdentifyError::short(&balance.name, found, expected)
}

fn too_short_to_cut(balance: &ForceBalance, least: usize) -> IdentifyError {
    let signals = &balance.signals;
    let recorded = signals.time[signals.time.len() - 1] - signals.time[0];
    let found = format!("{recorded:.2} s ({} rows)", (recorded / balance.sampling).round() + 1.0);
    let expected = format!(
        "{:.1} s for {} that fit, select and report, or three records of {:.1} s each",
        tenths(seconds(least, least - 1, balance)),
        needed(least, balance),
        tenths(seconds(FEW, 0, balance))
    );
    IdentifyError::short(&balance.name, found, expected)
}

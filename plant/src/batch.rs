//! Many simulations in parallel.

use rayon::iter::{IntoParallelRefIterator, ParallelIterator};

/// Runs `simulate` for every case, in parallel, and returns the results in the cases' order.
///
/// `threads` is the number of threads: 0 for one per core, 1 for the caller's own. Results do not
/// depend on it, as each call gets its own case. If a pool of that size cannot be created, the
/// cases run on the caller's thread.
pub fn simulate<Case: Sync, Outcome: Send>(
    cases: &[Case],
    threads: usize,
    simulate: impl Fn(&Case) -> Outcome + Sync,
) -> Vec<Outcome> {
    let all = || cases.par_iter().map(&simulate).collect();
    match threads {
        0 => all(),
        1 => cases.iter().map(simulate).collect(),
        _ => match rayon::ThreadPoolBuilder::new().num_threads(threads).build() {
            Ok(pool) => pool.install(all),
            Err(_) => cases.iter().map(simulate).collect(),
        },
    }
}

//! Many simulations at once, on all cores: what an identification asks of a plant.

use rayon::iter::{IntoParallelRefIterator, ParallelIterator};

/// Runs `simulate` for every case, in parallel, and returns the results in the cases' order.
///
/// `threads` limits how many run at once; 0 for all cores, 1 for none beside the caller. Each call
/// gets its own case and makes its own plant, so results do not depend on the number of threads.
/// Where a pool of that size cannot be made (no more threads are allowed), it runs on the caller's
/// thread.
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

//! The thread that learns between trials, run again: what it made of the records that the player
//! returned. The setpoints tell when the player had its results.

use std::collections::VecDeque;

use experiment::ilc_trial::{IlcResult, Returned};
use experiment::ilc_update::IlcUpdater;
use experiment::player::{IlcJob, Player};

use crate::report::NotCompared;

/// The worker thread of one experiment process.
#[derive(Debug, Default)]
pub(crate) struct LearningReplay {
    /// The learning run in progress, with its number.
    active: Option<(u32, IlcUpdater)>,
    /// What the player has not received yet.
    results: VecDeque<IlcResult>,
}

impl LearningReplay {
    /// Whether a learning run is in progress.
    pub(crate) const fn is_active(&self) -> bool {
        self.active.is_some()
    }

    /// The next result, in the order in which they came to be.
    pub(crate) fn result(&mut self) -> Option<IlcResult> {
        self.results.pop_front()
    }

    /// Does what the player has to be done after a step.
    ///
    /// # Errors
    /// A learning run goes on from a file, which is in no recording.
    pub(crate) fn work(&mut self, player: &mut Player) -> Result<(), NotCompared> {
        while let Some(job) = player.job() {
            match job {
                IlcJob::Begin { run_id, program, segment, resumed } => {
                    let Some(plan) = program.plan(segment as usize) else { continue };
                    if resumed || plan.learn().load.is_some() {
                        return Err(NotCompared::LearntBefore);
                    }
                    self.active = None;
                    match IlcUpdater::new(plan.as_ref().clone(), segment, None, None) {
                        Ok(updater) => {
                            self.results.push_back(updater.ready(run_id));
                            self.active = Some((run_id, updater));
                        }
                        Err(_) => self.results.push_back(IlcResult::failed(run_id)),
                    }
                }
                IlcJob::Returned(Returned::Record(record)) => {
                    let of_it = self.active.as_mut().filter(|(run_id, _)| *run_id == record.run_id);
                    let Some((run_id, updater)) = of_it else { continue };
                    let updated = updater.update(&record);
                    self.results.push_back(IlcResult::updated(record, updated.reference));
                    if updated.failed {
                        self.results.push_back(IlcResult::failed(*run_id));
                    }
                }
                IlcJob::Returned(Returned::Reference(_)) => {}
                IlcJob::End(ilc) => {
                    let is_it = |(run_id, _): &(u32, IlcUpdater)| *run_id == ilc.run_id();
                    if self.active.as_ref().is_some_and(is_it) {
                        self.active = None;
                    }
                }
            }
        }
        Ok(())
    }
}

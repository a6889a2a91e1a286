//! The player's side of iterative learning, between the loop, which allocates nothing, and the
//! worker thread, which does.

use std::sync::Arc;

use ipc_types::AXES;

use super::ilc_job::{IlcJob, JOBS};
use super::{Player, Program};
use crate::ilc_trial::{IlcOutcome, IlcResult, IlcTrials};

impl Player {
    /// The next job for the worker thread; fetch all of them after each step.
    pub fn job(&mut self) -> Option<IlcJob> {
        if let Some(ilc) = &mut self.ilc {
            while self.jobs.len() < JOBS - 2
                && let Some(returned) = ilc.returned()
            {
                self.jobs.push_back(IlcJob::Returned(returned));
            }
        }
        self.jobs.pop_front()
    }

    /// Takes back a job that the worker thread could not accept now.
    pub fn return_job(&mut self, job: IlcJob) {
        self.jobs.push_front(job);
    }

    /// Receives a result. A learning run that cannot continue stops the protocol.
    pub fn receive(&mut self, result: IlcResult) {
        let (failed, run_id) = (result.outcome == IlcOutcome::Failed, result.run_id);
        match &mut self.ilc {
            Some(ilc) => {
                ilc.receive(result);
                if failed && ilc.run_id() == run_id {
                    self.stop();
                }
            }
            // It belongs to a finished learning run.
            None => result.memory().for_each(|returned| self.push(IlcJob::Returned(returned))),
        }
    }

    /// Records the slaves' positions at a scan (rad or m; NaN where not measured; time in ns,
    /// CLOCK_MONOTONIC), and whether the motor had power. Only learning runs use them.
    pub fn record(&mut self, scan_ns: u64, slave: &[f64; AXES], powered: bool) {
        if let Some(ilc) = &mut self.ilc
            && let Some(step) =
                self.program.as_ref().and_then(|program| program.steps.get(self.segment as usize))
        {
            ilc.record(scan_ns, slave[step.axis], powered);
        }
    }

    /// The trial (block) being played, from 1; 0 outside a learning run's trials.
    pub fn block(&self) -> u32 {
        self.ilc.as_ref().map_or(0, IlcTrials::block)
    }

    /// Begins a learning run if the segment is of that kind.
    pub(super) fn begin_ilc(
        &mut self,
        program: &Arc<Program>,
        segment: usize,
        begun_ns: u64,
        resumed: bool,
    ) {
        self.end_ilc();
        if let Some(step) = program.steps.get(segment)
            && let Some(plan) = &step.plan
        {
            self.run_ids = self.run_ids.wrapping_add(1);
            let run_id = self.run_ids;
            self.ilc = Some(IlcTrials::new(run_id, &plan.schedule, self.rest[step.axis], begun_ns));
            let program = Arc::clone(program);
            self.push(IlcJob::Begin { run_id, program, segment: segment as u32, resumed });
        }
    }

    pub(super) fn end_ilc(&mut self) {
        if let Some(ilc) = self.ilc.take() {
            self.push(IlcJob::End(ilc));
        }
    }

    fn push(&mut self, job: IlcJob) {
        if self.jobs.len() < JOBS {
            self.jobs.push_back(job);
        } else {
            // The queue is full: leaking memory is better than freeing it in the loop.
            std::mem::forget(job);
        }
    }
}

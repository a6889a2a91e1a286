//! Samples and segments in, the sessions' performance and results out.

use emg::{MuscleActivity, MuscleSample};
use ipc_types::{
    EMG_MAXIMUM, EmgMaximum, Event, EventKind, PERFORMANCE, Performance, Process, SESSION,
    SYNC_ORDER, Sample, SessionOutcome, SessionResult, Severity, SyncOrder,
};
use rig::RigFile;
use rtrb::Producer;
use runtime::{Losses, PortError, Publisher, Service};

use super::thread_link::Dropped;
use crate::matching_bar::Effort;
use crate::player::{Change, Player, Program};
use crate::session_state::{SessionState, SessionStep};
use crate::session_tracker::{SessionReport, SessionTracker};

/// Most reports that are published in a cycle, so that no subscriber's buffer runs over; the others
/// wait for the next.
const REPORTS_A_CYCLE: usize = 16;

/// The sessions, and their ports.
#[derive(Debug)]
pub(super) struct SessionPorts {
    tracker: SessionTracker,
    /// The electrodes of the rig, which are filtered all the time, so that no session begins with
    /// filters that have not settled; `None` where no muscle belongs to a group.
    muscles: Option<MuscleActivity>,
    performance: Publisher<Performance>,
    results: Publisher<SessionResult>,
    maxima: Publisher<EmgMaximum>,
    sync: Publisher<SyncOrder>,
}

impl SessionPorts {
    pub(super) fn open(service: &mut Service, rig: &RigFile) -> Result<Self, PortError> {
        let electrodes = rig.electrodes();
        // A checked rig file has filters that its rate bears.
        let muscles =
            MuscleActivity::new(&electrodes, &rig.emg, f64::from(rig.rates.acquisition_hz));
        let muscles = muscles.ok().filter(|_| !electrodes.is_empty());
        let performance = service.publisher(PERFORMANCE)?;
        let results = service.publisher(SESSION)?;
        let sync = service.publisher(SYNC_ORDER)?;
        let tracker = SessionTracker::new(f64::from(rig.rates.acquisition_hz));
        let maxima = service.publisher(EMG_MAXIMUM)?;
        Ok(Self { tracker, muscles, performance, results, maxima, sync })
    }

    /// Goes on with the sessions of a protocol that is resumed.
    pub(super) fn resume(&mut self, player: &Player, order: u32, state: &SessionState) {
        if let Some(program) = player.program() {
            self.tracker.begin(order, program.sessions(), Some(state));
        }
    }

    /// Takes a sample.
    pub(super) fn see(&mut self, sample: &Sample, player: &Player) {
        let volume = player.since_volume_s(sample.scan_time_ns);
        let muscles = self.muscles.as_mut();
        let MuscleSample { activity, rectified } =
            muscles.map_or(MuscleSample::NONE, |it| it.update(&sample.analog_v, volume));
        // A sample with a torque that is not finite counts as missing.
        if let Some(torque) = sample.hand_torques() {
            let (at_ns, tick) = (sample.scan_time_ns, sample.tick);
            self.tracker.see(Effort { at_ns, tick, torque, activity, rectified });
        }
    }

    /// Takes a change of the player's state, after the step that made it at `now_ns`; `order` is
    /// the number of the order being played.
    pub(super) fn follow(
        &mut self,
        change: Change,
        player: &Player,
        order: u32,
        now_ns: u64,
    ) -> Result<(), PortError> {
        let Some(program) = player.program() else { return Ok(()) };
        if matches!(change, Change::Started | Change::Continued(_)) {
            let before = program.continues().map(|from| &from.sessions);
            self.tracker.begin(order, program.sessions(), before);
            if let Some(muscles) = &mut self.muscles {
                muscles.clear_artefact();
            }
        }
        if matches!(change, Change::Started | Change::Continued(_) | Change::Resumed(_)) {
            self.use_maxima(program, now_ns)?;
        }
        let next =
            player.playing().and_then(|(segment, begun_ns)| program.played(segment, begun_ns));
        let begun_ns = next.map_or(now_ns, |next| next.begun_ns);
        let (at_ns, outcome) = match change {
            Change::Started | Change::Continued(_) | Change::Segment(_) => {
                (begun_ns, SessionOutcome::Whole)
            }
            Change::Resumed(_) => (begun_ns, SessionOutcome::Interrupted),
            Change::Done => (player.last_edge_ns(), SessionOutcome::Whole),
            Change::Stopped(_) | Change::Aborted(..) => (now_ns, SessionOutcome::Stopped),
        };
        self.tracker.pass_edge(at_ns, outcome, next);
        if let Some(next) = next
            && let Some(number) = next.session
        {
            // At once: the session's samples are counted only when they have come.
            let (at_ns, segment) = (next.begun_ns, next.segment);
            self.sync.send(SyncOrder { at_ns, number, segment, ..SyncOrder::default() })?;
        }
        Ok(())
    }

    /// From now on activity is a share of the maxima that the program uses; tells which.
    fn use_maxima(&mut self, program: &Program, now_ns: u64) -> Result<(), PortError> {
        let maxima = program.maxima();
        if let Some(muscles) = &mut self.muscles {
            muscles.set_maxima(maxima);
        }
        let Some(maximum) = maxima.copied() else { return Ok(()) };
        let has = |inputs, at: usize| inputs | u16::from(maximum[at] > 0.0) << at;
        self.maxima.send(EmgMaximum {
            begun_ns: now_ns,
            ended_ns: now_ns,
            maximum,
            inputs: (0..maximum.len()).fold(0, has),
            used: 1,
            ..EmgMaximum::default()
        })?;
        Ok(())
    }

    /// Counts the samples up to `now_ns`, publishes what is new, and hands on what a restart needs.
    pub(super) fn publish(
        &mut self,
        now_ns: u64,
        steps: &mut Producer<(u32, SessionStep)>,
        dropped: &Dropped,
        service: &mut Service,
    ) -> Result<(), PortError> {
        self.tracker.advance(now_ns);
        let mut event = |kind, severity, text: &str, segment, (a, b, c): (f64, f64, f64)| {
            let event = Event::new(Process::Experiment, kind, severity, text);
            service.publish(Event { a, b, c, segment, ..event })
        };
        for _ in 0..REPORTS_A_CYCLE {
            match self.tracker.take_report() {
                None => break,
                Some(SessionReport::Performance(performance)) => {
                    self.performance.send(performance)?;
                }
                Some(SessionReport::Started(number, segment)) => {
                    let values = (f64::from(number), f64::from(self.tracker.sessions()), 0.0);
                    event(EventKind::SessionStarted, Severity::Info, "", segment, values)?;
                }
                Some(SessionReport::Ended(result)) => {
                    self.results.send(result)?;
                    let outcome = SessionOutcome::from_code(result.outcome);
                    let outcome = outcome.unwrap_or(SessionOutcome::Stopped);
                    let severity = match (outcome, result.samples_missed, result.samples) {
                        (SessionOutcome::Whole, 0, 1..) => Severity::Info,
                        _ => Severity::Warning,
                    };
                    let values = (f64::from(result.number), result.value[0], result.value[1]);
                    let segment = result.segment;
                    event(EventKind::SessionOver, severity, outcome.text(), segment, values)?;
                }
                Some(SessionReport::Contracted(maximum)) => {
                    self.maxima.send(maximum)?;
                }
                Some(SessionReport::Step(order, step)) => {
                    // The ring is full only if the request thread has hung for minutes; then a
                    // restart would resume with an earlier target.
                    if steps.push((order, step)).is_err() {
                        dropped.count();
                    }
                }
            }
        }
        Ok(())
    }

    /// Keeps the lists of subscribers current: there may be no session for hours.
    pub(super) fn refresh(&self) {
        self.performance.refresh();
        self.maxima.refresh();
        self.sync.refresh();
        self.results.refresh();
    }

    pub(super) fn losses(&self, losses: Losses) -> Losses {
        let sent = losses.sent(self.performance.undelivered()).sent(self.results.undelivered());
        let sent = sent.sent(self.sync.undelivered()).sent(self.maxima.undelivered());
        Losses { dropped: sent.dropped + self.tracker.dropped(), ..sent }
    }
}

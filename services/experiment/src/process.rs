//! The process: samples in, setpoints out, on the grid.

mod current_protocol;
mod ilc_worker;
mod interrupted_writer;
mod player_events;
mod progress;
mod request_handler;
mod scan_reports;
mod session_reports;
mod thread_link;

use std::fs;
use std::io;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use ipc_types::{
    EnableToken, EventKind, HOME_ORDER, Heartbeat, HomeOrder, Process, Profile, SAMPLE, SETPOINT,
    Sample, Setpoint, Severity, TOKEN,
};
use rig::protocol::Protocol;
use rig::{Axis, RigFile};
use rtrb::PushError;
use runtime::clock::{MILLISECOND_NS, now_ns};
use runtime::{
    Grid, Losses, PortError, Publisher, Service, ServiceError, Subscriber, Wake, Worker,
};
use thiserror::Error;

use crate::cycle::{Received, Seen};
use crate::interrupted::InterruptedFile;
use crate::player::{Output, Permission, Player, Program};
use crate::state::PlayerState;

use current_protocol::Current;
use ilc_worker::IlcWorker;
use interrupted_writer::InterruptedWriter;
use player_events::{publish_change, publish_notice};
use progress::AxisBits;
use request_handler::RequestHandler;
use scan_reports::ScanPorts;
use session_reports::SessionPorts;
use thread_link::{ChangeReport, LoopSide, Order};

/// Period of the heartbeat (ns).
const HEARTBEAT_NS: u64 = 50 * MILLISECOND_NS;
/// Name of the state's file.
const STATE: &str = "experiment.state";
/// Name of the file with the state of a learning run between two blocks.
const ILC_STATE: &str = "experiment.ilc";
/// Name of the folder of learnt references, where none was given.
const LEARNT: &str = "learnt";

/// Why the process ended.
#[derive(Debug, Error)]
#[allow(missing_docs)]
pub enum ExperimentError {
    #[error(transparent)]
    Service(#[from] ServiceError),
    #[error(transparent)]
    Port(#[from] PortError),
    #[error("the thread that answers requests, or the one that learns, ended")]
    ThreadEnded,
}

/// Runs the experiment process on the rig of that name until a signal ends it; `learnt` as in
/// [`Runner::new`].
///
/// # Errors
/// [`ExperimentError`].
pub fn run(rig_name: &str, rig: &RigFile, learnt: Option<&Path>) -> Result<(), ExperimentError> {
    let service = Service::start(Process::Experiment, rig_name)?;
    Runner::new(service, rig, learnt)?.run()
}

/// The experiment process, joined to a rig.
#[derive(Debug)]
pub struct Runner {
    service: Service,
    samples: Subscriber<Sample>,
    tokens: Subscriber<EnableToken>,
    token: Option<EnableToken>,
    setpoints: Publisher<Setpoint>,
    home_orders: Publisher<HomeOrder>,
    scan: ScanPorts,
    sessions: SessionPorts,
    heartbeats: Publisher<Heartbeat>,
    player: Player,
    link: LoopSide,
    grid: Grid,
    received: Received,
    newest: Option<Sample>,
    axes: Vec<Axis>,
    requests: Worker,
    ilc_worker: IlcWorker,
}

impl Runner {
    /// Opens the ports and resumes the protocol that an earlier process of this session was
    /// playing. `learnt` is the folder of the learnt references; `None`: in the rig's run
    /// directory, where they last as long as the rig is up.
    ///
    /// # Errors
    /// Those of the ports. A saved state that cannot be used is reported as an event.
    pub fn new(
        mut service: Service,
        rig: &RigFile,
        learnt: Option<&Path>,
    ) -> Result<Self, ExperimentError> {
        let directory = service.domain().name().make_run_directory().map_err(ServiceError::from)?;
        let file = directory.join(STATE);
        let learnt = learnt.map_or_else(|| directory.join(LEARNT), Path::to_owned);
        let mut player = Player::default();
        let session = service.identity().session;
        let current = match restore(&file, &learnt, session, rig, &mut player) {
            Ok(current) => current,
            Err(reason) => {
                service.event(EventKind::ProtocolStopped, Severity::Error, [0.0; 3], &reason)?;
                None
            }
        };
        let mut sessions = SessionPorts::open(&mut service, rig)?;
        if let Some(current) = &current {
            sessions.resume(&player, current.order, &current.sessions);
            if let Some(event) = current.lost_session(player.status().segment) {
                service.publish(event)?;
            }
        }
        let (link, request_side) = thread_link::pair();
        let fifo = service.domain().fifo();
        let ilc_worker = IlcWorker::open(
            session,
            directory.join(ILC_STATE),
            learnt.clone(),
            fifo,
            link.dropped.clone(),
        )
        .map_err(ServiceError::from)?;
        // Before the request thread starts, so that its first answer knows the restored protocol.
        link.progress.update(0, &player.status(), 0, false, AxisBits::default());
        let interrupted = InterruptedFile::new(&learnt, service.domain().name().as_str());
        let keys = current.as_ref().map_or_else(Vec::new, |current| current.keys.clone());
        let handler = RequestHandler {
            rig: rig.clone(),
            session,
            file,
            writer: InterruptedWriter::start(interrupted.clone()).map_err(ServiceError::from)?,
            interrupted,
            learnt,
            link: request_side,
            retired: current.iter().map(|current| Arc::clone(&current.program)).collect(),
            current,
            trouble: String::new(),
            last_order: 0,
        };
        Ok(Self {
            samples: service.subscriber(SAMPLE)?,
            tokens: service.subscriber(TOKEN)?,
            token: None,
            setpoints: service.publisher(SETPOINT)?,
            home_orders: service.publisher(HOME_ORDER)?,
            scan: ScanPorts::open(&mut service, keys)?,
            sessions,
            heartbeats: service.heartbeat_publisher()?,
            requests: handler.serve(service.domain().name())?,
            grid: Grid::of_rate(rig.rates.experiment_hz, rig.phases.experiment_ns),
            player,
            link,
            received: Received::default(),
            newest: None,
            axes: rig.axes.clone(),
            ilc_worker,
            service,
        })
    }

    /// The flag that ends [`Runner::run`]; signals set it.
    pub fn stop_flag(&self) -> Arc<AtomicBool> {
        self.service.stop_flag()
    }

    /// Serves requests until a signal ends the process.
    ///
    /// # Errors
    /// Those of the ports, and [`ExperimentError::ThreadEnded`].
    pub fn run(mut self) -> Result<(), ExperimentError> {
        let profile = self.service.enter_loop()?;
        let mut last_beat = 0;
        while !self.service.stopping() {
            let Some(wake) = self.grid.wait() else { continue };
            self.cycle(&wake)?;
            // Slots of the clock, not times since the last one: a late wake does not lower the
            // rate.
            let beat = wake.woke_ns / HEARTBEAT_NS;
            if beat != last_beat {
                last_beat = beat;
                self.heartbeat(profile)?;
                // Late subscribers receive the earlier events only through this.
                self.service.refresh_events();
                // The process may be idle for hours: keep the list of subscribers current.
                self.setpoints.refresh();
                self.home_orders.refresh();
                self.scan.refresh();
                self.sessions.refresh();
            }
            let losses = self.losses();
            if self.service.end_cycle(&self.grid, &wake, losses)?
                && (self.requests.is_closed() || self.ilc_worker.is_closed())
            {
                return Err(ExperimentError::ThreadEnded);
            }
            self.service.beat();
        }
        self.service.end()?;
        Ok(())
    }

    /// One cycle: allocates, locks and formats nothing.
    fn cycle(&mut self, wake: &Wake) -> Result<(), PortError> {
        self.receive()?;
        self.take_orders(wake.woke_ns);
        let seen = Seen {
            sample: self.newest.as_ref(),
            token: self.token.as_ref(),
            renewed_ns: self.link.progress.renewed_ns(),
            received: self.received,
        };
        let permission = seen.permission(wake.woke_ns);
        if let Some(output) = seen.step(&mut self.player, wake.woke_ns) {
            self.publish(&output, wake.woke_ns)?;
        }
        self.sessions.publish(
            wake.woke_ns,
            &mut self.link.steps,
            &self.link.dropped,
            &mut self.service,
        )?;
        while let Some(job) = self.player.job() {
            if let Err(PushError::Full(job)) = self.ilc_worker.jobs.push(job) {
                self.player.return_job(job);
                break;
            }
        }
        let enabled = matches!(permission, Permission::Enabled(_));
        let axes = axis_bits(&self.axes, self.newest.as_ref());
        let sample_ns = self.newest.map_or(0, |sample| sample.time_ns);
        let status = self.player.status();
        self.link.progress.update(self.received.order, &status, sample_ns, enabled, axes);
        Ok(())
    }

    /// Takes what has come, but for the orders.
    fn receive(&mut self) -> Result<(), PortError> {
        // Every sample: learning needs the slave's position at each step, however late this loop
        // wakes.
        while let Some(sample) = self.samples.take()? {
            self.received.sample(&sample, &mut self.player);
            self.sessions.see(&sample, &self.player);
            self.newest = Some(sample);
        }
        self.scan.tell(&mut self.player, &mut self.received, &mut self.link.keys)?;
        while let Ok(result) = self.ilc_worker.results.pop() {
            self.received.result(result, &mut self.player);
        }
        while let Ok(event) = self.link.events.pop().or_else(|_| self.ilc_worker.events.pop()) {
            self.service.publish(event)?;
        }
        self.token = self.tokens.latest()?.or(self.token);
        Ok(())
    }

    fn take_orders(&mut self, woke_ns: u64) {
        while let Ok(order) = self.link.orders.pop() {
            match order {
                // The client is told that the request timed out, so it must not start now.
                Order::Play { deadline_ns, .. } if now_ns() > deadline_ns => {}
                Order::Play { number, program, .. } => {
                    // The request handler holds this program and the previous one, so nothing is
                    // freed here. Without permission the player's step ends the protocol.
                    let epoch = self.token.map_or(0, |token| token.epoch);
                    self.received.play(number, program, epoch, &mut self.player);
                    self.link.progress.renew(woke_ns);
                }
                Order::Stop { number } => self.received.stop(number, &mut self.player),
            }
        }
    }

    /// Publishes what a step of the player has come to.
    fn publish(&mut self, output: &Output, woke_ns: u64) -> Result<(), PortError> {
        if let Some(setpoint) = output.setpoint {
            self.setpoints.send(setpoint)?;
        }
        if let Some(order) = self.player.home_order() {
            self.home_orders.send(order)?;
        }
        if let Some(notice) = self.player.take_notice() {
            publish_notice(notice, self.player.status().segment, &mut self.service)?;
        }
        self.scan.publish(&mut self.player, &mut self.service)?;
        if let Some(change) = output.change {
            let run = self.received.run;
            let program = self.player.program().map(AsRef::as_ref);
            publish_change(change, program, &mut self.service)?;
            self.sessions.follow(change, &self.player, run, woke_ns)?;
            if change.ends() {
                self.scan.end();
            }
            let (epoch, scan) = (self.player.epoch(), self.player.scan_state());
            let report = ChangeReport { order: run, change, epoch, scan };
            // The ring is full only if the request thread has hung for minutes; then a restart
            // would resume at an earlier segment.
            if self.link.changes.push(report).is_err() {
                self.link.dropped.count();
            }
        }
        Ok(())
    }

    fn losses(&self) -> Losses {
        let losses = Losses::default()
            .received(self.samples.counters())
            .received(self.tokens.counters())
            .sent(self.setpoints.undelivered())
            .sent(self.home_orders.undelivered());
        let dropped = self.link.dropped.total() + self.player.scan_reports_dropped();
        let losses = Losses { dropped, ..self.scan.losses(losses) };
        self.sessions.losses(losses)
    }

    fn heartbeat(&mut self, profile: Profile) -> Result<(), PortError> {
        self.heartbeats.send(Heartbeat {
            lost: self.samples.counters().lost,
            pid: std::process::id(),
            source: Process::Experiment.code(),
            state: u8::from(self.player.is_running()),
            profile: profile.code(),
            ..Heartbeat::default()
        })?;
        Ok(())
    }
}

/// What a sample shows of the axes.
fn axis_bits(axes: &[Axis], sample: Option<&Sample>) -> AxisBits {
    let Some(sample) = sample else { return AxisBits::default() };
    let beyond = axes.iter().enumerate().filter(|(at, axis)| axis.leaves_range(*at, sample));
    AxisBits { homed: sample.homed, beyond_range: beyond.fold(0, |bits, (at, _)| bits | 1 << at) }
}

/// Sets the player to what was being played in this session; `None` where nothing was. A file that
/// cannot be used is moved aside, so that it is told of once.
fn restore(
    file: &Path,
    learnt: &Path,
    session: u64,
    rig: &RigFile,
    player: &mut Player,
) -> Result<Option<Current>, String> {
    let bytes = match fs::read(file) {
        Ok(bytes) => bytes,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(format!("the saved state cannot be read: {error}")),
    };
    let result = PlayerState::decode(&bytes).map_err(|error| error.to_string()).and_then(|state| {
        if state.session != session || !state.running {
            return Ok(None);
        }
        let protocol =
            Protocol::parse(&state.text, &state.name).map_err(|error| error.to_string())?;
        let program = Program::new(&protocol, rig).map_err(|error| error.to_string())?;
        let program = program.with_pulses(&state.pulses)?.with_maxima(learnt, rig)?;
        let program = Arc::new(program);
        player.resume(&state, Arc::clone(&program)).map_err(|error| error.to_string())?;
        let PlayerState { client, sessions, keys, .. } = state;
        Ok(Some(Current { client, sessions, keys, ..Current::new(0, client, program) }))
    });
    if result.is_err() {
        // Nothing better can be done where even that fails: it is then told at each start.
        let _ = fs::rename(file, file.with_extension("damaged"));
    }
    result
}

//! The operator's part of the demo: verbs, protocol, kills.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::RecvTimeoutError;
use std::time::{Duration, Instant};

use anyhow::{Context as _, bail};
use ipc_types::{
    CARD_SCAN, COMMAND, CardScan, EnableToken, ExperimentRequest, GateCause, GateState,
    LoggerRequest, MotorCommand, Process, PulseSource, SAMPLE, Sample, SimulatorRequest, Split,
    TOKEN, TripCause, Verb, WatchdogState,
};
use operator::{RigLink, Up};
use recording::mcap_write::key;
use rig::load_protocol;
use rig::protocol::Protocol;
use runtime::Subscriber;
use runtime::clock::now_ns;
use rustix::process::Signal;

use crate::analysis::Kill;
use crate::terminal::Terminal;

/// How long a process may take to be back.
const BACK_LIMIT: Duration = Duration::from_secs(15);
/// How long a verb may be refused, while the rig comes to rest and faults clear.
const VERB_LIMIT: Duration = Duration::from_secs(15);
/// How much longer than planned a protocol may take.
const PROTOCOL_MARGIN: Duration = Duration::from_secs(20);
/// Period at which the topics are polled.
const POLL_PERIOD: Duration = Duration::from_millis(2);
/// Delay before a refused verb is tried again.
const RETRY_PERIOD: Duration = Duration::from_millis(100);
/// Number of trips without a kill after which the run is aborted: the host is too busy.
const UNPROVOKED: usize = 60;
/// Least motor voltage (V) and master speed (rad/s or m/s) at which a movement counts as under way.
const MOVING_V: f64 = 1.0;
const MOVING_SPEED: f64 = 1.0;
/// How long after power is back the next kill may come.
const SETTLED: Duration = Duration::from_millis(700);
/// Longest wait for the handle to move.
const MOVEMENT_LIMIT: Duration = Duration::from_secs(4);

/// Ctrl-C, or another signal that asks for an end.
#[derive(Debug, thiserror::Error)]
#[error("interrupted")]
pub(crate) struct Interrupted;

/// The kills, and the trips that happened without one.
#[derive(Clone, Debug)]
pub(crate) struct Done {
    pub(crate) kills: Vec<Kill>,
    /// Causes of the trips that no kill explains.
    pub(crate) unprovoked: Vec<TripCause>,
}

/// A kill, and what was seen of its consequences so far.
#[derive(Clone, Copy)]
struct Watched {
    kill: Kill,
    /// Incarnation of the killed process.
    incarnation: Option<u64>,
    /// The card's first scan at 0 V since (ns, CLOCK_MONOTONIC).
    zero_volts_ns: Option<u64>,
    /// When the next incarnation first published (ns, CLOCK_MONOTONIC).
    back_ns: Option<u64>,
}

/// A running rig and its operator.
pub(crate) struct Session<'a> {
    link: RigLink,
    up: &'a Up,
    terminal: &'a Terminal,
    stop: &'a AtomicBool,
    tokens: Subscriber<EnableToken>,
    scans: Subscriber<CardScan>,
    samples: Subscriber<Sample>,
    commands: Subscriber<MotorCommand>,
    token: Option<EnableToken>,
    sample: Option<Sample>,
    command: Option<MotorCommand>,
    /// The kill whose consequences are being watched.
    watched: Option<Watched>,
    powered_at: Instant,
    /// The effect that is yet to be put into the machine.
    to_hide: Option<String>,
}

impl<'a> Session<'a> {
    /// Of a rig that is up; `hidden` is the effect (`ID@SITE=SIZE`) that its machine gets once it
    /// is homed: not every effect would let the stops be found.
    pub(crate) fn open(
        up: &'a Up,
        terminal: &'a Terminal,
        stop: &'a AtomicBool,
        hidden: Option<&str>,
    ) -> anyhow::Result<Self> {
        let link = RigLink::open(&up.running.status.rig_name.parse()?)?;
        Ok(Self {
            tokens: link.subscriber(TOKEN)?,
            scans: link.subscriber(CARD_SCAN)?,
            samples: link.subscriber(SAMPLE)?,
            commands: link.subscriber(COMMAND)?,
            link,
            up,
            terminal,
            stop,
            token: None,
            sample: None,
            command: None,
            watched: None,
            powered_at: Instant::now(),
            to_hide: hidden.map(str::to_owned),
        })
    }

    /// Plays the protocol to its end, killing each of `victims` in mid-movement: `(process, from
    /// which second of the protocol)`. A trip ends the protocol; it is then started anew.
    pub(crate) fn play(
        &mut self,
        protocol: &Protocol,
        victims: &[(Process, f64)],
    ) -> anyhow::Result<Done> {
        let recording = self.link.logger(&LoggerRequest::Status)?;
        if recording.recording.is_none() {
            bail!("the logger does not record: {}", recording.error);
        }
        self.terminal.progress("reset, arm, enable");
        let took_s = self.power()?;
        self.terminal.print(&format!("reset, armed, enabled by the operator after {took_s:.1} s"));
        let client = operator::client_number();
        self.home(client)?;
        self.hide()?;
        self.start(protocol, client)?;
        self.terminal.print(&format!(
            "protocol \"{}\" runs, {:.0} s",
            protocol.name,
            protocol.duration_s()
        ));
        let mut done = Done { kills: Vec::new(), unprovoked: Vec::new() };
        let longest = Duration::from_secs_f64(protocol.duration_s()) + PROTOCOL_MARGIN;
        let mut limit = Instant::now() + longest;
        let mut victims = victims.iter();
        let mut next = victims.next();
        let labels: Vec<&str> =
            protocol.sequence().map(|(_, segment)| segment.label.as_str()).collect();
        loop {
            self.pause(Duration::from_millis(50))?;
            let answer = match self.link.experiment(&ExperimentRequest::Renew { client }) {
                Ok(answer) => answer,
                Err(_) if Instant::now() < limit => continue,
                Err(error) => return Err(error.into()),
            };
            if answer.permission_lost || self.state() != WatchdogState::Enabled {
                done.unprovoked.push(self.unprovoked()?);
                if done.unprovoked.len() >= UNPROVOKED {
                    bail!(
                        "the watchdog tripped {UNPROVOKED} times by itself; is the machine this \
                            busy? (farreach probe top)"
                    );
                }
                self.start(protocol, client)?;
                limit = Instant::now() + longest;
                continue;
            }
            if !answer.error.is_empty() {
                bail!("the experiment process reports: {}", answer.error);
            }
            if !answer.running {
                if !answer.completed {
                    bail!("the protocol was stopped before its end");
                }
                if let Some((process, _)) = next {
                    bail!(
                        "the protocol came to its end before {process} could be killed; give it \
                            more --seconds"
                    );
                }
                break;
            }
            if Instant::now() > limit {
                bail!(
                    "the protocol did not come to its end within {PROTOCOL_MARGIN:?} of its time"
                );
            }
            let label = labels.get(answer.segment as usize).copied().unwrap_or_default();
            self.terminal.progress(format!(
                "{label}, {:.0} of {:.0} s",
                answer.elapsed_s, answer.duration_s
            ));
            if let Some((process, from_s)) = next
                && answer.elapsed_s >= *from_s
                && self.powered_at.elapsed() >= SETTLED
            {
                done.kills.push(self.kill(*process)?);
                next = victims.next();
                self.start(protocol, client)?;
                limit = Instant::now() + longest;
            }
        }
        self.terminal.print("protocol done");
        Ok(done)
    }

    /// Plays the protocol that finds the stops, unless every axis is homed. A trip, which a busy
    /// host causes, starts it anew.
    fn home(&mut self, client: u64) -> anyhow::Result<()> {
        let homed = |session: &Self| {
            session.sample.is_some_and(|sample| sample.homed.count_ones() >= sample.axes.into())
        };
        self.wait(Duration::from_secs(2), |session| session.sample.is_some())?;
        if homed(self) {
            return Ok(());
        }
        let axes = self.sample.map_or(1, |sample| usize::from(sample.axes));
        let protocol = load_protocol(rig::home_protocol(axes).as_ref(), &[])?;
        let begun = Instant::now();
        for _ in 0..UNPROVOKED {
            self.start(&protocol, client)?;
            loop {
                self.pause(Duration::from_millis(50))?;
                let answer = self.link.experiment(&ExperimentRequest::Renew { client })?;
                self.terminal.progress(format!("homing, {:.0} s", answer.elapsed_s));
                if answer.running {
                    continue;
                }
                if answer.completed && homed(self) {
                    let took_s = begun.elapsed().as_secs_f64();
                    self.terminal.print(&format!("homed between its stops after {took_s:.0} s"));
                    return Ok(());
                }
                if !answer.permission_lost && self.state() == WatchdogState::Enabled {
                    bail!("the rig could not be homed: {}", answer.error);
                }
                break;
            }
        }
        bail!("the watchdog tripped {UNPROVOKED} times while the rig was homed")
    }

    /// Puts the effect into the machine, once.
    fn hide(&mut self) -> anyhow::Result<()> {
        let Some(effect) = self.to_hide.take() else { return Ok(()) };
        let answer = self.link.simulator(&SimulatorRequest::Effects { effects: vec![effect] })?;
        if !answer.error.is_empty() {
            bail!("the simulated card reports: {}", answer.error);
        }
        Ok(())
    }

    /// Starts the protocol; if the rig has just tripped, resets, arms and enables it first.
    fn start(&mut self, protocol: &Protocol, client: u64) -> anyhow::Result<()> {
        let request = ExperimentRequest::Run {
            protocol: protocol.text().to_owned(),
            name: protocol.file_name().to_owned(),
            client,
            pulses: PulseSource::Line,
        };
        let played = [(key::PROTOCOL, &*protocol.name), (key::PROTOCOL_FILE, protocol.text())];
        let metadata = played.map(|(key, value)| (key.to_owned(), value.to_owned())).into();
        self.link.logger(&LoggerRequest::Run { metadata })?;
        loop {
            let begun = self.link.experiment(&request)?;
            if begun.error.is_empty() {
                return Ok(());
            }
            self.pause(POLL_PERIOD)?;
            if self.state() == WatchdogState::Enabled {
                bail!("the experiment process refused the protocol: {}", begun.error);
            }
            self.power()?;
        }
    }

    /// Plays a protocol to its end into a recording of its own, and takes power away.
    pub(crate) fn record(&mut self, protocol: &Protocol, file: &Path) -> anyhow::Result<()> {
        let path = file.to_str().context("expected a path in UTF-8")?.to_owned();
        let start = LoggerRequest::Start { path, metadata: Vec::new(), split: Split::default() };
        let begun = self.link.logger(&start)?;
        if !begun.error.is_empty() {
            bail!("the logger reports: {}", begun.error);
        }
        let played = self.play(protocol, &[]);
        self.finish()?;
        played.map(|_| ())
    }

    /// Runs a computation in a thread of its own. An interruption does not wait for it: the process
    /// ends once the rig is down.
    pub(crate) fn compute<T: Send + 'static>(
        &self,
        computation: impl FnOnce() -> T + Send + 'static,
    ) -> anyhow::Result<T> {
        let (sender, done) = std::sync::mpsc::channel();
        std::thread::Builder::new().name("computation".to_owned()).spawn(move || {
            // Nobody waits for it after an interruption.
            let _unwanted = sender.send(computation());
        })?;
        loop {
            match done.recv_timeout(POLL_PERIOD) {
                Ok(result) => return Ok(result),
                Err(RecvTimeoutError::Timeout) if !self.stop.load(Ordering::Relaxed) => {}
                Err(RecvTimeoutError::Timeout) => return Err(Interrupted.into()),
                Err(RecvTimeoutError::Disconnected) => bail!("the computation came to no end"),
            }
        }
    }

    /// Takes power away, ends the recording. Returns how many messages the logger wrote.
    pub(crate) fn finish(&mut self) -> anyhow::Result<u64> {
        let answer = operator::verb(&self.link, Verb::Disarm).context("disarm")?;
        self.terminal.progress(format!("{}, the recording ends", answer.state));
        // so that the last scans show the motor at 0 V
        self.pause(Duration::from_millis(200))?;
        let stopped = self.link.logger(&LoggerRequest::Stop)?;
        if !stopped.error.is_empty() {
            self.terminal.warn(&format!("logger: {}", stopped.error));
        }
        Ok(stopped.written)
    }

    /// Kills a process in mid-movement and brings the rig back to power.
    fn kill(&mut self, process: Process) -> anyhow::Result<Kill> {
        self.wait_for_movement()?;
        let status = launch::status(&self.up.running.run_dir)?;
        let unit = status.unit(process.text()).and_then(|unit| unit.process);
        let victim =
            unit.with_context(|| format!("the launcher knows of no process of {process}"))?;
        let incarnation = match process {
            Process::Control => self.command.map(|command| command.incarnation),
            _ => self.sample.map(|sample| sample.incarnation),
        };
        let kill = Kill { process, at_ns: now_ns() };
        self.watched = Some(Watched { kill, incarnation, zero_volts_ns: None, back_ns: None });
        if !victim.signal(Signal::KILL) {
            bail!("{process} ({victim}) was dead before it was killed");
        }
        self.terminal.progress(format!("{process} killed with SIGKILL"));
        let tripped = self.wait(BACK_LIMIT, |session| session.state() != WatchdogState::Enabled)?;
        if !tripped {
            bail!("{process} was killed and the watchdog did not trip within {BACK_LIMIT:?}");
        }
        let back_ns = |session: &Self| session.watched.and_then(|watched| watched.back_ns);
        if !self.wait(BACK_LIMIT, |session| back_ns(session).is_some())? {
            bail!("{process} was killed and did not publish again within {BACK_LIMIT:?}");
        }
        let ms = |time_ns: u64| time_ns.saturating_sub(kill.at_ns) as f64 * 1e-6;
        let back_ms = back_ns(self).map_or(f64::NAN, ms);
        let zero_volts = match self.watched.and_then(|watched| watched.zero_volts_ns) {
            Some(zero_volts_ns) => format!("motor at 0 V after {:.1} ms", ms(zero_volts_ns)),
            None => "motor NOT at 0 V".to_owned(),
        };
        let took_s = self.power()?;
        self.watched = None;
        self.terminal.print(&format!(
            "{process} killed: {zero_volts}; back after {back_ms:.0} ms; reset, armed, enabled \
                after {took_s:.1} s more"
        ));
        Ok(kill)
    }

    /// Reports a trip that no kill explains, and enables the rig again.
    fn unprovoked(&mut self) -> anyhow::Result<TripCause> {
        let cause = self
            .token
            .and_then(|token| TripCause::from_code(token.cause))
            .unwrap_or(TripCause::None);
        let gate = self.sample.and_then(|sample| GateCause::from_code(sample.gate_cause));
        let words = match (cause, gate) {
            (TripCause::GateLatched, Some(gate)) => format!("{cause}: {gate}"),
            _ => cause.to_string(),
        };
        let took_s = self.power()?;
        self.terminal.warn(&format!(
            "the watchdog tripped without a kill ({words}); enabled again after {took_s:.1} s"
        ));
        Ok(cause)
    }

    /// Resets, arms and enables the rig; retries each verb until it is accepted. Returns the time
    /// that it took (s).
    fn power(&mut self) -> anyhow::Result<f64> {
        let begun = Instant::now();
        'verbs: loop {
            for verb in [Verb::Reset, Verb::Arm, Verb::Enable] {
                loop {
                    self.pause(POLL_PERIOD)?;
                    let refused = match self.link.verb(verb) {
                        Ok(answer) if answer.done => break,
                        Ok(answer) => {
                            format!("{} (the watchdog is {})", answer.reason, answer.state)
                        }
                        Err(error) => error.to_string(),
                    };
                    if begun.elapsed() > VERB_LIMIT {
                        bail!("`{}` was refused for {VERB_LIMIT:?}: {refused}", verb.text());
                    }
                    self.terminal.progress(format!("{}: {refused}", verb.text()));
                    self.pause(RETRY_PERIOD)?;
                    // A fault that came meanwhile sends the operator back to the first verb.
                    if verb != Verb::Reset
                        && matches!(self.state(), WatchdogState::Tripped | WatchdogState::Faulted)
                    {
                        continue 'verbs;
                    }
                }
            }
            // The gate must open as well, or the watchdog withdraws the permission.
            let open = |session: &Self| {
                session.state() == WatchdogState::Enabled
                    && session
                        .sample
                        .is_some_and(|sample| sample.gate_state == GateState::Open.code())
            };
            if self.wait(Duration::from_millis(500), open)? {
                self.powered_at = Instant::now();
                return Ok(begun.elapsed().as_secs_f64());
            }
            if begun.elapsed() > VERB_LIMIT {
                bail!("the gate did not open within {VERB_LIMIT:?} although power was enabled");
            }
        }
    }

    /// Waits until the motor has voltage and the master moves.
    fn wait_for_movement(&mut self) -> anyhow::Result<()> {
        let moving = |session: &Self| {
            let volts = session.sample.is_some_and(|sample| sample.motor_v[0].abs() >= MOVING_V);
            volts
                && session.command.is_some_and(|command| command.velocity[0].abs() >= MOVING_SPEED)
        };
        if !self.wait(MOVEMENT_LIMIT, moving)? {
            self.terminal.warn(&format!(
                "the master hardly moved for {MOVEMENT_LIMIT:?}; killing the process nevertheless"
            ));
        }
        Ok(())
    }

    fn state(&self) -> WatchdogState {
        self.token
            .and_then(|token| WatchdogState::from_code(token.state))
            .unwrap_or(WatchdogState::Faulted)
    }

    /// Polls the topics until `until` holds; returns `false` at the time limit.
    fn wait(&mut self, limit: Duration, until: impl Fn(&Self) -> bool) -> anyhow::Result<bool> {
        let begun = Instant::now();
        loop {
            self.poll()?;
            if until(self) {
                return Ok(true);
            }
            if begun.elapsed() > limit {
                return Ok(false);
            }
            std::thread::sleep(POLL_PERIOD);
        }
    }

    fn pause(&mut self, time: Duration) -> anyhow::Result<()> {
        self.wait(time, |_| false).map(|_| ())
    }

    /// Notes the first message of a successor.
    fn note(&mut self, process: Process, incarnation: u64, time_ns: u64) {
        if let Some(watched) = &mut self.watched
            && watched.kill.process == process
            && watched.incarnation != Some(incarnation)
        {
            watched.back_ns.get_or_insert(time_ns);
        }
    }

    fn poll(&mut self) -> anyhow::Result<()> {
        if self.stop.load(Ordering::Relaxed) {
            return Err(Interrupted.into());
        }
        self.token = self.tokens.latest()?.or(self.token);
        while let Some(command) = self.commands.take()? {
            self.command = Some(command);
            self.note(Process::Control, command.incarnation, command.time_ns);
        }
        while let Some(sample) = self.samples.take()? {
            self.sample = Some(sample);
            self.note(Process::Acquisition, sample.incarnation, sample.time_ns);
        }
        while let Some(scan) = self.scans.take()? {
            if let Some(watched) = &mut self.watched
                && scan.scan_time_ns >= watched.kill.at_ns
            {
                let before = watched.zero_volts_ns.or(Some(scan.scan_time_ns));
                watched.zero_volts_ns = before.filter(|_| scan.motor_v[0] == 0.0);
            }
        }
        Ok(())
    }
}

//! Monitors a rig under test: reads all topics, and publishes setpoints of a slow sine, so that the
//! motor gets voltage whenever it is enabled.
//!
//! Time is counted in ticks of the card (0.5 ms). The simulated card simulates every tick, even if
//! it is late, so its scans show what the motor got and when, however loaded the host is.

use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::TAU;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use std::thread::JoinHandle;
use std::time::Duration;

use iceoryx2::node::Node;
use iceoryx2::service::ipc;
use ipc_types::{
    CARD_SCAN, COMMAND, CardScan, ENABLE_LINE, EnableLine, EnableToken, Message, Mode,
    MotorCommand, Process, Profile, SAMPLE, SETPOINT, Sample, Setpoint, TOKEN, TOPICS, TripCause,
    WatchdogState,
};
use runtime::clock::{MILLISECOND_NS, SECOND_NS, now_ns};
use runtime::{Domain, RawSubscriber, RigName, Service, Timeouts, open_raw};

use super::host::Hogs;
use super::{TestRig, told, wait_for};

/// Period of the card in `launch/rigs/hydrostatic.toml` (2 kHz) (ns).
pub const TICK_NS: u64 = 500_000;
/// Limit of waiting; only a test that fails reaches it.
pub const LIMIT: Duration = Duration::from_secs(30);

const AMPLITUDE_RAD: f64 = 0.25;
const SPEED_RAD_S: f64 = TAU * 0.7;

/// The tick of a time.
pub fn tick_of(time_ns: u64) -> u64 {
    time_ns / TICK_NS
}

/// Ticks after a process's last message within which the motor must be at 0 V: the bounds of the
/// safety case plus one cycle of each process in between. `None` if there is no bound.
pub fn off_bound(process: &str, profile: Profile) -> Option<u64> {
    let timeouts = Timeouts::of(profile);
    let bound_ns = match process {
        // The card itself is gone: nothing drives the motor, and the next card starts without
        // power.
        "simulator" => 0,
        // Tokens and line stop at once.
        "watchdog" => timeouts.enable_line_ns.max(timeouts.token_ns),
        // The enable line pauses (SR-24).
        "acquisition" if profile == Profile::Realtime => 10 * MILLISECOND_NS,
        "acquisition" => 60 * MILLISECOND_NS,
        // The gate is faster, but without real-time scheduling it may be late itself; then the
        // enable line ends it.
        "control" => timeouts.peer_lost_ns + timeouts.enable_line_ns,
        _ => return None,
    };
    Some(bound_ns / TICK_NS + SLACK)
}

/// Ticks for one cycle of each process, and for the rounding of times to ticks.
pub const SLACK: u64 = 6;

/// Identity under which a test sends what no process of the rig has sent; it is not observed.
pub const STRANGER: u64 = 0x5354_5241_4e47_4552;

/// State of the motor in one scan of the card.
#[derive(Clone, Copy, Debug)]
pub struct Scan {
    pub tick: u64,
    pub incarnation: u64,
    /// Whether the enable line is alive.
    pub power: bool,
    /// Whether volts reach the motor.
    pub volts: bool,
    /// Whether the DACs hold volts that may or may not reach the motor.
    pub dac: bool,
}

/// The fields of one token that tests use.
#[derive(Clone, Copy, Debug)]
pub struct Token {
    pub time_ns: u64,
    pub incarnation: u64,
    pub epoch: u64,
    pub enabled: bool,
    pub state: WatchdogState,
    pub cause: TripCause,
}

/// One incarnation of a topic's sender.
#[derive(Clone, Copy, Debug)]
pub struct Sender {
    pub incarnation: u64,
    pub sequence: u64,
    pub last_ns: u64,
}

/// One topic.
#[derive(Clone, Debug, Default)]
pub struct Stream {
    /// Its senders, in the order of their first message.
    pub senders: Vec<Sender>,
    /// Longest pause between two messages of one sender since the mark (ns).
    pub pause_ns: u64,
    /// Messages that this reader missed.
    pub lost: u64,
    /// Messages whose sequence went backwards within an incarnation.
    pub backwards: u64,
}

impl Stream {
    pub fn newest(&self) -> Sender {
        *self.senders.last().unwrap()
    }
}

/// All messages received.
#[derive(Debug, Default)]
pub struct Seen {
    /// Since the mark.
    pub scans: Vec<Scan>,
    /// Since the mark.
    pub tokens: Vec<Token>,
    /// Time and count of the enable line's last change of level by one watchdog.
    pub toggled: (u64, u64),
    pub streams: BTreeMap<&'static str, Stream>,
    pub sample: Option<Sample>,
    pub command: Option<MotorCommand>,
    pub token_message: Option<EnableToken>,
    pub setpoint: Option<Setpoint>,
    pub newest_scan: Option<Scan>,
    pub newest_token: Option<Token>,
    /// Epoch of tokens that a test has forged: they are not the watchdog's.
    forged_epoch: Option<u64>,
    failure: Option<String>,
}

impl Seen {
    fn take_in(&mut self, topic: &'static str, bytes: &[u8]) {
        let word =
            |index: usize| u64::from_le_bytes(bytes[8 * index..8 * index + 8].try_into().unwrap());
        // Every message begins with session, incarnation, sequence and time.
        let (incarnation, sequence, time_ns) = (word(1), word(2), word(3));
        if incarnation == STRANGER {
            return;
        }
        let stream = self.streams.entry(topic).or_default();
        match stream.senders.iter_mut().find(|sender| sender.incarnation == incarnation) {
            Some(sender) => {
                if sequence <= sender.sequence {
                    stream.backwards += 1;
                }
                stream.lost += sequence.saturating_sub(sender.sequence + 1);
                stream.pause_ns = stream.pause_ns.max(time_ns.saturating_sub(sender.last_ns));
                *sender = Sender { incarnation, sequence, last_ns: time_ns };
            }
            None => stream.senders.push(Sender { incarnation, sequence, last_ns: time_ns }),
        }
        match topic {
            _ if topic == CARD_SCAN.topic.name => {
                let scan = CardScan::from_bytes(bytes).unwrap();
                let some = |volts: &[f64]| volts.iter().any(|&v| v != 0.0);
                let scan = Scan {
                    tick: scan.tick,
                    incarnation,
                    power: scan.motor_power == 1,
                    volts: some(&scan.motor_v),
                    dac: some(&scan.dac_v),
                };
                self.newest_scan = Some(scan);
                self.scans.push(scan);
            }
            _ if topic == TOKEN.topic.name => {
                let token = EnableToken::from_bytes(bytes).unwrap();
                if self.forged_epoch == Some(token.epoch) {
                    return;
                }
                self.token_message = Some(token);
                let token = Token {
                    time_ns,
                    incarnation,
                    epoch: token.epoch,
                    enabled: token.enabled == 1,
                    state: WatchdogState::from_code(token.state).unwrap(),
                    cause: TripCause::from_code(token.cause).unwrap(),
                };
                self.newest_token = Some(token);
                self.tokens.push(token);
            }
            _ if topic == ENABLE_LINE.topic.name => {
                let toggles = EnableLine::from_bytes(bytes).unwrap().toggles;
                // A watchdog that starts begins at 0, which keeps no motor powered.
                if toggles != self.toggled.1 && toggles != 0 {
                    self.toggled = (time_ns, toggles);
                }
            }
            _ if topic == SAMPLE.topic.name => self.sample = Sample::from_bytes(bytes),
            _ if topic == COMMAND.topic.name => self.command = MotorCommand::from_bytes(bytes),
            _ if topic == SETPOINT.topic.name => self.setpoint = Setpoint::from_bytes(bytes),
            _ => {}
        }
    }

    /// The last tick since the mark in which volts reached the motor.
    pub fn last_volts(&self) -> Option<u64> {
        self.scans.iter().filter(|scan| scan.volts).map(|scan| scan.tick).max()
    }

    /// The last tick since the mark in which the card had the motor powered.
    pub fn last_power(&self) -> Option<u64> {
        self.scans.iter().filter(|scan| scan.power).map(|scan| scan.tick).max()
    }

    /// Time of the last token since the mark that gave permission.
    pub fn last_leave_ns(&self) -> Option<u64> {
        self.tokens.iter().filter(|token| token.enabled).map(|token| token.time_ns).max()
    }

    /// Causes that the watchdog named since the mark while it was tripped or faulted.
    pub fn causes(&self) -> BTreeSet<TripCause> {
        let faulted =
            |token: &&Token| matches!(token.state, WatchdogState::Tripped | WatchdogState::Faulted);
        self.tokens.iter().filter(faulted).map(|token| token.cause).collect()
    }

    /// Times at which power, volts and permission came and went since the mark, and the longest
    /// pauses, for messages.
    pub fn account(&self) -> String {
        let mut text = String::new();
        let mut before = None;
        for scan in &self.scans {
            if before.replace((scan.incarnation, scan.power))
                != Some((scan.incarnation, scan.power))
            {
                text += &format!(
                    "card {:x} tick {} power {}\n",
                    scan.incarnation, scan.tick, scan.power
                );
            }
        }
        let mut before = None;
        for token in &self.tokens {
            let now = (token.incarnation, token.epoch, token.state, token.cause);
            if before.replace(now) != Some(now) {
                text += &format!("watchdog tick {} {now:x?}\n", tick_of(token.time_ns));
            }
        }
        let toggled = tick_of(self.toggled.0);
        text += &format!("line last toggled at tick {toggled}, toggle {}\n", self.toggled.1);
        for (topic, stream) in &self.streams {
            let pause_ms = stream.pause_ns as f64 * 1e-6;
            text += &format!(
                "{topic}: pause {pause_ms:.1} ms, missed by this reader {}\n",
                stream.lost
            );
        }
        text
    }

    /// Whether the card has come to this tick.
    fn has_come_to(&self, tick: u64) -> bool {
        self.newest_scan.is_some_and(|scan| scan.tick >= tick)
    }

    pub fn state(&self) -> Option<WatchdogState> {
        self.newest_token.map(|token| token.state)
    }
}

/// A member of the rig under test. Leaves it when dropped.
pub struct Monitor {
    seen: Arc<Mutex<Seen>>,
    domain: Domain,
    stop: Arc<AtomicBool>,
    leads: Arc<AtomicBool>,
    reader: Option<JoinHandle<()>>,
    hogs: Option<Hogs>,
}

impl Monitor {
    /// Joins the rig, and starts to read all topics and publish setpoints.
    pub fn join(name: &RigName) -> Self {
        let domain = Domain::observe(name).unwrap();
        let seen = Arc::new(Mutex::new(Seen::default()));
        let stop = Arc::new(AtomicBool::new(false));
        let leads = Arc::new(AtomicBool::new(true));
        let (seen_too, stop_too, leads_too, name) =
            (Arc::clone(&seen), Arc::clone(&stop), Arc::clone(&leads), name.clone());
        let reader = std::thread::spawn(move || {
            if let Err(error) = read_and_lead(&name, &seen_too, &stop_too, &leads_too) {
                seen_too.lock().unwrap().failure = Some(error.to_string());
            }
        });
        let monitor = Self { seen, domain, stop, leads, reader: Some(reader), hogs: None };
        monitor.until("all fast topics speak", |seen| {
            seen.newest_token.is_some() && seen.command.is_some()
        });
        monitor
    }

    /// Keeps this many cores busy at normal priority while the monitor lives, in the real-time
    /// profile only: its scheduling class must keep other programs from delaying the rig.
    pub fn load(&mut self, cores: usize) {
        self.hogs = Hogs::in_realtime(cores, self.profile());
    }

    /// Whether it publishes setpoints (it does from the beginning).
    pub fn lead(&self, leads: bool) {
        self.leads.store(leads, Ordering::Relaxed);
    }

    /// The observations. Hold the lock only briefly: the reader waits for it.
    pub fn seen(&self) -> MutexGuard<'_, Seen> {
        let seen = self.seen.lock().unwrap();
        if let Some(failure) = &seen.failure {
            panic!("the reader failed: {failure}");
        }
        seen
    }

    pub fn profile(&self) -> Profile {
        self.domain.profile()
    }

    pub fn timeouts(&self) -> Timeouts {
        Timeouts::of(self.domain.profile())
    }

    /// Forgets scans and tokens so far; returns the time.
    pub fn mark(&self) -> u64 {
        let mut seen = self.seen();
        seen.scans.clear();
        seen.tokens.clear();
        seen.streams.values_mut().for_each(|stream| stream.pause_ns = 0);
        now_ns()
    }

    /// Waits until the observations satisfy a condition.
    pub fn until(&self, what: &str, mut holds: impl FnMut(&Seen) -> bool) {
        let came = wait_for(LIMIT, || holds(&self.seen()));
        assert!(
            came,
            "never came: {what}; token {:?}, {:?}",
            self.seen().newest_token,
            self.seen().newest_scan
        );
    }

    /// Lets this many ticks of the card pass.
    pub fn pass_ticks(&self, ticks: u64) {
        let from = tick_of(now_ns());
        self.until("ticks of the card", |seen| seen.has_come_to(from + ticks));
    }

    /// The same, or twice their time where there is no card meanwhile.
    pub fn pass_or_time(&self, ticks: u64) {
        let from = tick_of(now_ns());
        let twice = Duration::from_nanos(2 * ticks * TICK_NS);
        let _passed = wait_for(twice, || self.seen().has_come_to(from + ticks));
    }

    /// A node of this test's process.
    pub fn node(&self) -> Node<ipc::Service> {
        self.domain.node("visitor").unwrap()
    }

    /// Tokens of this epoch are forged, and are not taken for the watchdog's.
    pub fn ignore_epoch(&self, epoch: u64) {
        self.seen().forged_epoch = Some(epoch);
    }

    /// `reset`, `arm`, `enable` on the command line, as the state requires, until volts flow. A
    /// loaded host may stall for longer than a timeout and trip the rig again; then from the
    /// beginning.
    pub fn power_up(&self, rig: &TestRig) {
        let mut last = String::new();
        let done = wait_for(LIMIT, || {
            let state = self.seen().state().unwrap();
            let verb = match state {
                WatchdogState::Faulted | WatchdogState::Tripped => "reset",
                WatchdogState::Disarmed => "arm",
                WatchdogState::Armed => "enable",
                WatchdogState::Enabled => return self.volts_flow(),
            };
            let output = rig.run([verb]);
            last = format!("{verb}: {}", told(&output));
            // The token that shows it is on its way.
            if output.status.success() {
                let _shown =
                    wait_for(Duration::from_millis(300), || self.seen().state() != Some(state));
            }
            false
        });
        assert!(done, "no power: {last}\n{:?}", self.seen().newest_token);
    }

    /// Waits until volts flow right now; `false` where the watchdog is not enabled.
    pub fn volts_flow(&self) -> bool {
        wait_for(LIMIT, || {
            let seen = self.seen();
            seen.state() != Some(WatchdogState::Enabled)
                || seen.newest_scan.is_some_and(|scan| scan.volts)
        }) && self.seen().state() == Some(WatchdogState::Enabled)
    }

    /// Opens every topic again, as a program that starts now would.
    pub fn open_all(&self) {
        let node = self.node();
        for topic in TOPICS {
            open_raw(&node, topic).unwrap_or_else(|error| panic!("{error}"));
        }
    }
}

impl Drop for Monitor {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(reader) = self.reader.take() {
            let _ended = reader.join();
        }
    }
}

fn read_and_lead(
    name: &RigName,
    seen: &Mutex<Seen>,
    stop: &AtomicBool,
    leads: &AtomicBool,
) -> Result<(), Box<dyn std::error::Error>> {
    let mut service = Service::start(Process::Operator, name.as_str())?;
    let mut readers: Vec<(&'static str, Box<dyn RawSubscriber>)> = Vec::new();
    for topic in TOPICS {
        readers.push((topic.name, open_raw(service.node(), topic)?));
    }
    let mut setpoints = service.publisher(SETPOINT)?;
    service.ready()?;
    while !stop.load(Ordering::Relaxed) {
        if service.stopping() {
            // The signal handler of the service has replaced the default one.
            std::process::exit(130);
        }
        if leads.load(Ordering::Relaxed) {
            setpoints.send(sine(now_ns()))?;
        }
        {
            let mut seen = seen.lock().unwrap();
            for (topic, reader) in &mut readers {
                while reader.take(&mut |bytes| seen.take_in(topic, bytes))? {}
            }
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    Ok(())
}

fn sine(at_ns: u64) -> Setpoint {
    let (sine, cosine) = (SPEED_RAD_S * (at_ns % (1000 * SECOND_NS)) as f64 * 1e-9).sin_cos();
    Setpoint {
        at_ns,
        lease_until_ns: at_ns + SECOND_NS / 2,
        protocol: 1,
        position: [AMPLITUDE_RAD * sine, 0.0, 0.0],
        velocity: [AMPLITUDE_RAD * SPEED_RAD_S * cosine, 0.0, 0.0],
        acceleration: [-AMPLITUDE_RAD * SPEED_RAD_S.powi(2) * sine, 0.0, 0.0],
        peak_speed: [AMPLITUDE_RAD * SPEED_RAD_S, 0.0, 0.0],
        segments: 1,
        mode: Mode::Position.code(),
        owner: Process::Operator.code(),
        axes: 1,
        ..Setpoint::default()
    }
}

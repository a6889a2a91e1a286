//! The monitor of a rig: its axes, and what is published of them.

use ipc_types::{
    AXES, Event, EventKind, Innovation, ModelSite, ModelState, MonitorState, Process, Sample,
    Severity,
};
use plant::coupled_axes::HandleCoupling;
use plant::effects::{self, Site};
use rig::{AxisUnit, RigFile};

use crate::axis_monitor::{AxisMonitor, Seen};
use crate::departure::Verdict;
use crate::origin::Origin;

/// A baseline of so many encoder counts or more is that of a model which lacks something already:
/// an encoder alone makes less than a third of a count.
const LACKING_COUNTS: f64 = 1.0;

/// What is published.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Report {
    /// A row of innovations.
    Innovation(Innovation),
    /// The state of an axis.
    State(ModelState),
    /// Something happened.
    Event(Event),
}

/// One axis.
#[derive(Clone, Debug)]
struct Watched {
    monitor: AxisMonitor,
    name: String,
    /// One count of master and slave (rad); 0 without an encoder.
    count_rad: [f64; 2],
    began_tick: u64,
    blocks: u64,
    state: MonitorState,
    /// Tick of the sample with which the state was last published.
    told_tick: u64,
}

/// The monitor of a rig. Pure: time comes with the samples.
#[derive(Clone, Debug)]
pub struct RigMonitor {
    axes: Vec<Option<Watched>>,
    /// Why axes are not monitored, by axis.
    blind: Vec<(usize, String)>,
    coupling: HandleCoupling,
    rate_hz: u64,
}

impl RigMonitor {
    /// The monitor of every axis whose model can be simulated.
    pub fn new(rig: &RigFile) -> Self {
        let (mut axes, mut blind) = (Vec::new(), Vec::new());
        for (at, axis) in rig.axes.iter().enumerate().take(AXES) {
            let monitor = match axis.unit {
                AxisUnit::Radian => AxisMonitor::new(rig, at, axis).map_err(|e| e.to_string()),
                AxisUnit::Metre => {
                    Err("axes.unit: the model beside the machine needs an axis that turns".into())
                }
            };
            let slave = axis.slave.map_or(0.0, |slave| 1.0 / slave.counts_per_unit);
            let master = axis.master.turns_per_handle_turn / axis.master.counts_per_unit;
            let monitor = monitor.map_err(|reason| blind.push((at, reason))).ok();
            axes.push(monitor.map(|monitor| Watched {
                monitor,
                name: axis.name.clone(),
                count_rad: [master, slave],
                began_tick: 0,
                blocks: 0,
                state: MonitorState::Learning,
                told_tick: 0,
            }));
        }
        let products = HandleCoupling::of_pairs(rig.axes.len(), &rig.model.handle_coupling);
        let coupling = products.unwrap_or_default();
        Self { axes, blind, coupling, rate_hz: u64::from(rig.rates.acquisition_hz) }
    }

    /// What is told at the start: axes that are not monitored.
    pub fn blind(&self) -> impl Iterator<Item = Event> {
        self.blind.iter().map(|(at, reason)| {
            let (kind, severity) = (EventKind::NotMonitored, Severity::Warning);
            Event { a: *at as f64, ..Event::new(Process::Monitor, kind, severity, reason) }
        })
    }

    /// Whether no axis is monitored.
    pub fn is_blind(&self) -> bool {
        self.axes.iter().all(Option::is_none)
    }

    /// Takes the next sample, and hands over what is to be published.
    ///
    /// # Errors
    /// That of `publish`.
    pub fn see<E>(
        &mut self,
        sample: &Sample,
        publish: &mut dyn FnMut(Report) -> Result<(), E>,
    ) -> Result<(), E> {
        let mut accelerations = [0.0; AXES];
        let coupled = !self.coupling.is_none();
        if coupled {
            for (own, axis) in accelerations.iter_mut().zip(&self.axes) {
                *own = axis.as_ref().map_or(0.0, |axis| axis.monitor.slave_acceleration_rad_s2());
            }
        }
        for (at, axis) in self.axes.iter_mut().enumerate() {
            let Some(axis) = axis else { continue };
            let others = accelerations.iter().enumerate().filter(|(other, _)| *other != at);
            let of_others = |(other, acceleration): (usize, &f64)| {
                -self.coupling.between(at, other) * acceleration
            };
            let torque_nm = if coupled { others.map(of_others).sum() } else { 0.0 };
            axis.see(at, sample, torque_nm, publish)?;
            if sample.tick.saturating_sub(axis.told_tick) >= self.rate_hz {
                publish(Report::State(axis.message(at, sample.tick)))?;
                axis.told_tick = sample.tick;
            }
        }
        Ok(())
    }
}

impl Watched {
    fn see<E>(
        &mut self,
        at: usize,
        sample: &Sample,
        torque_nm: f64,
        publish: &mut dyn FnMut(Report) -> Result<(), E>,
    ) -> Result<(), E> {
        let learnt = self.monitor.baseline().is_some();
        let restarts = self.monitor.restarts();
        let seen = self.monitor.see(sample, torque_nm);
        let (row, verdict) = match seen {
            Seen::Nothing => (None, None),
            Seen::Row(row) => (Some(row), None),
            Seen::Block(row, verdict) => (Some(row), Some(verdict)),
        };
        let row = row.map(|row| (row.tick, row.declared));
        if self.began_tick == 0 || self.monitor.restarts() != restarts {
            self.began_tick = sample.tick;
        }
        if let Some((tick, [master, slave])) = row {
            publish(Report::Innovation(Innovation {
                tick,
                began_tick: self.began_tick,
                master,
                slave,
                axis: at as u8,
                slave_present: sample.slave_present >> at & 1,
                ..Innovation::default()
            }))?;
        }
        let Some(verdict) = verdict else { return Ok(()) };
        self.blocks += 1;
        self.state = match verdict {
            _ if self.monitor.baseline().is_none() => MonitorState::Learning,
            Verdict::Steady | Verdict::Returns => MonitorState::Steady,
            Verdict::Suspicious => MonitorState::Suspicious,
            Verdict::Departs | Verdict::Departed => MonitorState::Departed,
        };
        publish(Report::State(self.message(at, sample.tick)))?;
        self.told_tick = sample.tick;
        if !learnt && let Some(event) = self.learnt(at) {
            publish(Report::Event(event))?;
        }
        match verdict {
            Verdict::Departs => publish(Report::Event(self.departed(at))),
            Verdict::Returns => {
                let (kind, severity) = (EventKind::ModelReturned, Severity::Info);
                let event = Event::new(Process::Monitor, kind, severity, &self.name);
                publish(Report::Event(Event { a: at as f64, ..event }))
            }
            _ => Ok(()),
        }
    }

    fn message(&self, at: usize, tick: u64) -> ModelState {
        let monitor = &self.monitor;
        let ratio = |channel: usize| {
            monitor.baseline().map_or(0.0, |baseline| {
                monitor.energy()[channel].sqrt() / baseline.deviation_rad[channel]
            })
        };
        let origin = monitor.origin();
        let of = |value: fn(&Origin) -> f64| origin.map_or(0.0, value);
        ModelState {
            tick,
            departed_tick: monitor.departed_tick(),
            blocks: self.blocks,
            master_ratio: ratio(0),
            slave_ratio: ratio(1),
            cusum: monitor.detector().sums().into_iter().fold(0.0, f64::max),
            score: monitor.score().ratio,
            learnt: monitor.learnt(),
            deviation: monitor.parameters().map(|(_, share)| share.abs()).fold(0.0, f64::max),
            size: of(|origin| origin.size),
            explains: of(|origin| origin.explains),
            elsewhere: of(|origin| origin.elsewhere),
            restarts: monitor.restarts(),
            axis: at as u8,
            state: self.state.code(),
            site: origin.map_or(ModelSite::None, |origin| model_site(origin.site)).code(),
            ..ModelState::default()
        }
    }

    /// The baseline is known; with a warning where it is that of a model which lacks something.
    fn learnt(&self, at: usize) -> Option<Event> {
        let [b, c] = self.monitor.baseline()?.deviation_rad;
        let counts = |channel: usize, deviation: f64| deviation / self.count_rad[channel].max(1e-9);
        // A slave that is not observed wanders, and pulls at the master.
        let observed = self.count_rad[1] > 0.0;
        let most = if observed { counts(0, b).max(counts(1, c)) } else { 0.0 };
        let (severity, text) = if most > LACKING_COUNTS {
            let text = format!(
                "{}: {most:.1} encoder counts off: the model lacks something (farreach identify)",
                self.name
            );
            (Severity::Warning, text)
        } else {
            (Severity::Info, self.name.clone())
        };
        let event = Event::new(Process::Monitor, EventKind::BaselineLearnt, severity, &text);
        Some(Event { a: at as f64, b, c, ..event })
    }

    fn departed(&self, at: usize) -> Event {
        let (kind, severity) = (EventKind::ModelDeparted, Severity::Warning);
        let origin = self.monitor.origin();
        let text = match origin {
            Some(origin) => format!("{}: as {}", self.name, in_words(origin)),
            None => format!("{}: as no listed effect", self.name),
        };
        let (b, c) = origin.map_or((0.0, 0.0), |origin| (origin.size, origin.explains));
        Event { a: at as f64, b, c, ..Event::new(Process::Monitor, kind, severity, &text) }
    }
}

/// `backlash@slave=0.02 rad, which explains 92 % of it`.
fn in_words(origin: &Origin) -> String {
    let place = effects::entry(origin.id)
        .and_then(|entry| entry.sites.iter().find(|place| place.site == origin.site));
    let size = place.map_or_else(String::new, |place| {
        let size = origin.size * place.size;
        // A leak is some 1e-12 m³/(s Pa).
        let exact = (1e-3..1e4).contains(&size.abs());
        let size = if exact { format!("{size:.3}") } else { format!("{size:.2e}") };
        format!("={size} {}", place.unit)
    });
    let share = 100.0 * origin.explains;
    format!("{}@{}{size}, which explains {share:.0} % of it", origin.id, origin.site.name())
}

const fn model_site(site: Site) -> ModelSite {
    match site {
        Site::Drive => ModelSite::Drive,
        Site::Master => ModelSite::Master,
        Site::Line => ModelSite::Line,
        Site::Slave => ModelSite::Slave,
        Site::Sensor => ModelSite::Sensor,
    }
}

//! The process: reads samples, publishes innovations and the state of the model. It has no place in
//! the chain from card to motor; nothing waits for it.

use std::time::{Duration, Instant};

use ipc_types::{
    Heartbeat, INNOVATION, Innovation, MODEL_STATE, ModelState, Process, SAMPLE, Sample,
};
use rig::RigFile;
use runtime::{PortError, Publisher, Service, ServiceError, Subscriber};
use thiserror::Error;

use crate::rig_monitor::{Report, RigMonitor};

/// Period of the loop: a tenth of what the buffer of the samples holds.
const PERIOD: Duration = Duration::from_millis(40);
/// Period of the heartbeat.
const HEARTBEAT: Duration = Duration::from_millis(50);
/// Nice level: without real-time scheduling the loops go first.
const NICE: i32 = 10;

/// Why the process ended.
#[derive(Debug, Error)]
#[allow(missing_docs)]
pub enum MonitorError {
    #[error(transparent)]
    Service(#[from] ServiceError),
    #[error(transparent)]
    Port(#[from] PortError),
}

/// Runs the monitor of the rig of that name until a signal ends it.
///
/// # Errors
/// [`MonitorError`]. A model that cannot be simulated is told as an event, and the process then
/// does nothing else.
pub fn run(rig_name: &str, rig: &RigFile) -> Result<(), MonitorError> {
    let mut service = Service::start(Process::Monitor, rig_name)?;
    let _refused = rustix::process::nice(NICE);
    let mut monitor = RigMonitor::new(rig);
    let mut ports = Ports {
        samples: service.subscriber(SAMPLE)?,
        innovations: service.publisher(INNOVATION)?,
        states: service.publisher(MODEL_STATE)?,
        heartbeats: service.heartbeat_publisher()?,
    };
    service.ready()?;
    for event in monitor.blind() {
        service.publish(event)?;
    }
    let mut beat = Instant::now();
    while !service.stopping() {
        while let Some(sample) = ports.samples.take()? {
            let (innovations, states) = (&mut ports.innovations, &mut ports.states);
            monitor.see(&sample, &mut |report| match report {
                Report::Innovation(innovation) => innovations.send(innovation).map(drop),
                Report::State(state) => states.send(state).map(drop),
                Report::Event(event) => service.publish(event).map(drop),
            })?;
        }
        if beat.elapsed() >= HEARTBEAT {
            beat = Instant::now();
            service.refresh_events();
            ports.refresh();
            let heartbeat = ports.heartbeat(&service);
            ports.heartbeats.send(heartbeat)?;
        }
        service.beat();
        std::thread::sleep(PERIOD);
    }
    service.end()?;
    Ok(())
}

struct Ports {
    samples: Subscriber<Sample>,
    innovations: Publisher<Innovation>,
    states: Publisher<ModelState>,
    heartbeats: Publisher<Heartbeat>,
}

impl Ports {
    /// Keeps the lists of subscribers current while no samples come.
    fn refresh(&self) {
        self.innovations.refresh();
        self.states.refresh();
    }

    fn heartbeat(&self, service: &Service) -> Heartbeat {
        Heartbeat {
            lost: self.samples.counters().lost,
            pid: std::process::id(),
            source: Process::Monitor.code(),
            profile: service.domain().profile().code(),
            ..Heartbeat::default()
        }
    }
}

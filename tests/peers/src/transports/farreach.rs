//! The ports of farreach's own processes.

use std::sync::atomic::Ordering;
use std::time::Duration;

use ipc_types::{Process, SAMPLE};
use runtime::{Keeper, RigName, Service, stop_flag};

use crate::{Failure, Publish, Read};

/// Keeps the domain until SIGTERM; prints `ready` first.
pub(crate) fn keep(name: &str) -> Result<(), Failure> {
    let stop = stop_flag()?;
    let name: RigName = name.parse()?;
    let mut keeper = Keeper::start(&name)?;
    println!("ready");
    while !stop.load(Ordering::Relaxed) {
        keeper.clean(Duration::from_millis(250));
    }
    keeper.end()?;
    Ok(())
}

pub(crate) fn publisher(name: &str) -> Result<Publish, Failure> {
    let mut service = Service::start(Process::Acquisition, name)?;
    let mut samples = service.publisher(SAMPLE)?;
    service.enter_loop()?;
    Ok(Box::new(move |sample| {
        let _alive = &service;
        samples.send(sample)?;
        Ok(())
    }))
}

pub(crate) fn reader(name: &str) -> Result<Read, Failure> {
    let mut service = Service::start(Process::Control, name)?;
    let mut samples = service.subscriber(SAMPLE)?;
    service.enter_loop()?;
    Ok(Box::new(move || {
        let _alive = &service;
        Ok(samples.latest()?)
    }))
}

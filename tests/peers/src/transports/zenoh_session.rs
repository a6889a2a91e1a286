//! Zenoh between two peers on a Unix socket, with or without its shared memory. Its own threads
//! have ordinary scheduling.

use ::zenoh::handlers::RingChannel;
use ::zenoh::qos::CongestionControl;
use ::zenoh::shm::{BlockOn, GarbageCollect, ShmProviderBuilder};
use ::zenoh::{Config, Session, Wait as _};
use ipc_types::{Message as _, SAMPLE, Sample};
use runtime::clock::now_ns;

use crate::{Failure, Publish, Read};

/// Room for the payloads that are on their way (bytes).
const SHARED_BYTES: usize = 1024 * 1024;

fn session(name: &str, shared: bool, listen: bool) -> Result<Session, Failure> {
    let path = std::env::temp_dir().join(format!("{name}.socket"));
    let own = format!("[\"unixsock-stream/{}\"]", path.display());
    let none = "[]".to_owned();
    let (listens, connects) = if listen { (own, none) } else { (none, own) };
    let mut config = Config::default();
    for (key, value) in [
        ("mode", "\"peer\""),
        ("scouting/multicast/enabled", "false"),
        ("listen/endpoints", listens.as_str()),
        ("connect/endpoints", connects.as_str()),
        ("transport/shared_memory/enabled", if shared { "true" } else { "false" }),
        // From the first message on.
        ("transport/shared_memory/mode", "\"init\""),
    ] {
        config.insert_json5(key, value)?;
    }
    Ok(::zenoh::open(config).wait()?)
}

pub(crate) fn publisher(name: &str, shared: bool) -> Result<Publish, Failure> {
    let session = session(name, shared, false)?;
    let publisher = session
        .declare_publisher(SAMPLE.topic.name)
        .congestion_control(CongestionControl::Drop)
        .express(true)
        .wait()?;
    let provider = ShmProviderBuilder::default_backend(SHARED_BYTES).wait()?;
    let mut sequence = 0;
    Ok(Box::new(move |mut sample: Sample| {
        let _alive = &session;
        sample.stamp(1, 1, sequence, now_ns());
        sequence += 1;
        if shared {
            let allocated = provider.alloc(size_of::<Sample>());
            let mut payload = allocated.with_policy::<BlockOn<GarbageCollect>>().wait()?;
            payload.copy_from_slice(sample.as_bytes());
            publisher.put(payload).wait()?;
        } else {
            publisher.put(sample.as_bytes()).wait()?;
        }
        Ok(())
    }))
}

pub(crate) fn reader(name: &str, shared: bool) -> Result<Read, Failure> {
    let session = session(name, shared, true)?;
    let samples = session.declare_subscriber(SAMPLE.topic.name).with(RingChannel::new(1)).wait()?;
    Ok(Box::new(move || {
        let _alive = &session;
        let Some(came) = samples.try_recv()? else { return Ok(None) };
        if shared && came.payload().as_shm().is_none() {
            return Err("zenoh-shared: a payload came without shared memory".into());
        }
        Ok(Sample::from_bytes(&came.payload().to_bytes()))
    }))
}

//! iceoryx2 without farreach's ports, with the settings that farreach has for the topic `sample`.

use ::iceoryx2::prelude::*;
use ::iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use ipc_types::{Message as _, PUBLISHERS, SAMPLE, SUBSCRIBERS, Sample};
use runtime::clock::now_ns;

use crate::{Failure, Publish, Read};

/// As in farreach's ports.
const NODES: usize = 32;
const BORROWED: usize = 2;

type Service = PortFactory<ipc::Service, Sample, ()>;

fn service(name: &str) -> Result<(Node<ipc::Service>, Service), Failure> {
    set_log_level(LogLevel::Error);
    let mut config = Config::default();
    let root = std::env::temp_dir().join(name).to_string_lossy().into_owned();
    config.global.set_root_path(&root.as_str().try_into().map_err(said)?);
    config.global.prefix = format!("{name}_").as_str().try_into().map_err(said)?;
    let node = NodeBuilder::new()
        .config(&config)
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create::<ipc::Service>()
        .map_err(said)?;
    let topic = &SAMPLE.topic;
    let service = node
        .service_builder(&topic.name.try_into().map_err(said)?)
        .publish_subscribe::<Sample>()
        .max_publishers(PUBLISHERS)
        .max_subscribers(SUBSCRIBERS)
        .max_nodes(NODES)
        .subscriber_max_buffer_size(topic.buffer)
        .subscriber_max_borrowed_samples(BORROWED)
        .history_size(topic.history)
        .enable_safe_overflow(true)
        .open_or_create()
        .map_err(said)?;
    Ok((node, service))
}

pub(crate) fn publisher(name: &str) -> Result<Publish, Failure> {
    let (node, service) = service(name)?;
    let port = service
        .publisher_builder()
        .backpressure_strategy(BackpressureStrategy::DiscardData)
        .max_loaned_samples(1)
        .create()
        .map_err(said)?;
    let mut sequence = 0;
    Ok(Box::new(move |mut sample: Sample| {
        let _alive = (&node, &service);
        sample.stamp(1, 1, sequence, now_ns());
        sequence += 1;
        port.loan_uninit().map_err(said)?.write_payload(sample).send().map_err(said)?;
        Ok(())
    }))
}

pub(crate) fn reader(name: &str) -> Result<Read, Failure> {
    let (node, service) = service(name)?;
    let port =
        service.subscriber_builder().buffer_size(SAMPLE.topic.buffer).create().map_err(said)?;
    Ok(Box::new(move || {
        let _alive = (&node, &service);
        let mut newest = None;
        while let Some(sample) = port.receive().map_err(said)? {
            newest = Some(*sample.payload());
        }
        Ok(newest)
    }))
}

fn said(error: impl std::fmt::Debug) -> Failure {
    format!("iceoryx2: {error:?}").into()
}

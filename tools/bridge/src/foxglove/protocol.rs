//! The Foxglove WebSocket protocol, as far as a server that only sends needs it: what the server
//! says, as text and bytes, and what a viewer asks for. Its specification is
//! <https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md>; `foxglove.sdk.v1`, its
//! successor, has the same messages.

use ipc_types::Topic;
use recording::channel::{self, MESSAGE_ENCODING, SCHEMA_ENCODING};
use serde::Deserialize;
use serde_json::{Value, json};

/// The versions of the protocol that are spoken, the best one first.
pub(crate) const SUBPROTOCOLS: [&str; 2] = ["foxglove.sdk.v1", "foxglove.websocket.v1"];

/// First byte of a frame that carries a message.
const MESSAGE_DATA: u8 = 1;
/// Bytes in front of the message in its frame.
const FRAME_HEADER: usize = 1 + 4 + 8;

/// How grave a [`status`] is, by the protocol's numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Level {
    /// Something is not as it should be.
    Warning = 1,
    /// A request was refused.
    Error = 2,
}

/// One wish of [`Request::Subscribe`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Subscription {
    /// Number that the viewer gives it; its frames bear it.
    pub(crate) id: u32,
    /// Number of the channel.
    pub(crate) channel_id: u64,
}

/// What a viewer may ask for.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(tag = "op", rename_all = "camelCase", rename_all_fields = "camelCase")]
pub(crate) enum Request {
    /// Messages of channels from now on.
    Subscribe {
        /// Which.
        subscriptions: Vec<Subscription>,
    },
    /// No more of them.
    Unsubscribe {
        /// Numbers of the subscriptions.
        subscription_ids: Vec<u32>,
    },
}

/// Number of the channel of the topic with that index.
pub(crate) const fn channel_id(index: usize) -> u64 {
    index as u64 + 1
}

/// Index of the topic with that channel; `None` where there is none among `count`.
pub(crate) fn index_of(channel_id: u64, count: usize) -> Option<usize> {
    let index = usize::try_from(channel_id.checked_sub(1)?).ok()?;
    (index < count).then_some(index)
}

/// The first message: what this server is. It offers nothing beyond channels. A viewer that
/// connects again knows by `run` whether it is still the same bridge.
pub(crate) fn server_info(rig: &str, run: u64) -> String {
    json!({
        "op": "serverInfo",
        "name": format!("farreach, rig {rig}"),
        "capabilities": [],
        "metadata": { "farreach_version": env!("CARGO_PKG_VERSION"), "rig_name": rig },
        "sessionId": format!("{run:016x}"),
    })
    .to_string()
}

/// The second message: the channels, with the schemas of the recordings.
pub(crate) fn advertise(topics: &[&'static Topic]) -> String {
    let channels: Vec<Value> = topics
        .iter()
        .enumerate()
        .map(|(index, topic)| {
            json!({
                "id": channel_id(index),
                "topic": topic.name,
                "encoding": MESSAGE_ENCODING,
                "schemaName": topic.ros_name,
                "schemaEncoding": SCHEMA_ENCODING,
                "schema": (topic.schema)(),
                "metadata": channel::about(topic),
            })
        })
        .collect();
    json!({ "op": "advertise", "channels": channels }).to_string()
}

/// A message to the person at the viewer. It replaces the one before with the same `id`.
pub(crate) fn status(level: Level, id: &str, text: &str) -> String {
    json!({ "op": "status", "level": level as u8, "id": id, "message": text }).to_string()
}

/// The frame of a message: kind, number of the subscription, time (ns since 1970), payload;
/// little-endian.
pub(crate) fn frame(subscription: u32, wall_time_ns: u64, payload: &[u8]) -> Vec<u8> {
    let mut frame = Vec::with_capacity(FRAME_HEADER + payload.len());
    frame.push(MESSAGE_DATA);
    frame.extend_from_slice(&subscription.to_le_bytes());
    frame.extend_from_slice(&wall_time_ns.to_le_bytes());
    frame.extend_from_slice(payload);
    frame
}

/// Reads what a viewer asks for.
///
/// # Errors
/// What is wrong with it, in words.
pub(crate) fn parse(text: &str) -> Result<Request, String> {
    serde_json::from_str(text).map_err(|error| {
        format!("expected subscribe or unsubscribe; this bridge only sends: {error}")
    })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used)]

    use ipc_types::{COMMAND, Message, MotorCommand, SAMPLE, TOPICS};
    use recording::schema::Layout;

    use super::*;

    #[test]
    fn a_channel_is_described_well_enough_to_decode_its_messages() {
        let topics: Vec<_> = TOPICS.iter().collect();
        let told: Value = serde_json::from_str(&advertise(&topics)).unwrap();
        assert_eq!(told["op"], "advertise");
        let channels = told["channels"].as_array().unwrap();
        assert_eq!(channels.len(), TOPICS.len());
        for (index, (channel, topic)) in channels.iter().zip(TOPICS).enumerate() {
            let text = |key: &str| channel[key].as_str().unwrap();
            assert_eq!((text("topic"), text("encoding")), (topic.name, "cdr"));
            let layout =
                Layout::parse(text("schemaName"), text("schemaEncoding"), text("schema")).unwrap();
            assert_eq!((layout.size, layout.fields.len()), (topic.size, topic.fields.len()));
            let id = channel["id"].as_u64().unwrap();
            assert_eq!(index_of(id, TOPICS.len()), Some(index));
        }
        assert_eq!(index_of(0, 3), None);
        assert_eq!(index_of(4, 3), None);
        assert_eq!(index_of(u64::MAX, 3), None);
    }

    #[test]
    fn a_frame_is_laid_out_as_the_protocol_says() {
        let mut command = MotorCommand { volts: [1.5, 0.0, -2.0], ..MotorCommand::default() };
        command.stamp(1, 2, 3, 4);
        let mut payload = Vec::new();
        channel::put_payload(command.as_bytes(), &mut payload);
        let frame = frame(0x0403_0201, 0x1122_3344_5566_7788, &payload);
        let head = [1, 1, 2, 3, 4, 0x88, 0x77, 0x66, 0x55, 0x44, 0x33, 0x22, 0x11];
        assert_eq!(frame[..13], head);
        let topic = &COMMAND.topic;
        let layout = Layout::parse(topic.ros_name, "ros2msg", &(topic.schema)()).unwrap();
        let body = layout.body(&frame[13..]).unwrap();
        assert_eq!(MotorCommand::from_bytes(body), Some(command));
    }

    #[test]
    fn a_viewer_may_subscribe_and_unsubscribe_and_nothing_else() {
        let text = r#"{"op":"subscribe","subscriptions":[{"id":7,"channelId":1}]}"#;
        let subscriptions = vec![Subscription { id: 7, channel_id: 1 }];
        assert_eq!(parse(text), Ok(Request::Subscribe { subscriptions }));
        let text = r#"{"op":"unsubscribe","subscriptionIds":[7,8]}"#;
        assert_eq!(parse(text), Ok(Request::Unsubscribe { subscription_ids: vec![7, 8] }));
        for other in [
            "",
            "{}",
            r#"{"op":"advertise","channels":[]}"#,
            r#"{"op":"subscribe","subscriptions":[{"id":-1,"channelId":1}]}"#,
            r#"{"op":"unsubscribe"}"#,
        ] {
            assert!(parse(other).unwrap_err().contains("only sends"), "{other}");
        }
    }

    #[test]
    fn the_first_messages_are_objects_of_the_protocol() {
        let info: Value = serde_json::from_str(&server_info("bench", 255)).unwrap();
        assert_eq!(
            (&info["op"], &info["sessionId"]),
            (&json!("serverInfo"), &json!("00000000000000ff"))
        );
        assert_eq!(info["capabilities"], json!([]));
        let told: Value = serde_json::from_str(&status(Level::Warning, "losses", "x")).unwrap();
        assert_eq!(told, json!({"op": "status", "level": 1, "id": "losses", "message": "x"}));
        assert!(advertise(&[&SAMPLE.topic]).contains("\"sample\""));
    }
}

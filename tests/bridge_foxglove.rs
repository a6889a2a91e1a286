//! Viewers of the Foxglove WebSocket protocol on a running rig.
#![allow(clippy::unwrap_used, clippy::expect_used)]

#[path = "common/bridge_process.rs"]
mod bridge_process;
mod common;

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use bridge_process::Bridge;
use common::{Signal, TestRig, kill, told};
use futures_util::{SinkExt as _, StreamExt as _};
use ipc_types::{Process, SAMPLE, TOPICS, event_topic};
use recording::schema::Layout;
use serde_json::{Value, json};
use tokio::net::{TcpSocket, TcpStream};
use tokio::time::timeout;
use tokio_tungstenite::tungstenite::client::IntoClientRequest as _;
use tokio_tungstenite::tungstenite::{Error, Message};
use tokio_tungstenite::{WebSocketStream, client_async};

/// The `node_modules` of `npm install @foxglove/ws-protocol @foxglove/rosmsg
/// @foxglove/rosmsg2-serialization ws`; without it that part of the test is skipped.
const NODE_MODULES: &str = "FARREACH_NODE_MODULES";
const LIMIT: Duration = Duration::from_secs(60);
/// Samples that a viewer takes: two seconds.
const SAMPLES: usize = 4000;
/// What a viewer that does not read has room for (bytes).
const NARROW: u32 = 4096;

type Socket = WebSocketStream<TcpStream>;

/// Connects; `room` is what waits at this end at most (bytes), by itself if `None`.
async fn connect(
    address: &str,
    headers: &[(&'static str, &str)],
    room: Option<u32>,
) -> Result<Socket, Error> {
    let mut request = format!("ws://{address}/").into_client_request().unwrap();
    request.headers_mut().insert("sec-websocket-protocol", "foxglove.sdk.v1".parse().unwrap());
    for (name, value) in headers {
        request.headers_mut().insert(*name, value.parse().unwrap());
    }
    let socket = TcpSocket::new_v4().unwrap();
    if let Some(bytes) = room {
        socket.set_recv_buffer_size(bytes).unwrap();
    }
    let stream = socket.connect(address.parse().unwrap()).await.unwrap();
    let (socket, answer) = client_async(request, stream).await?;
    assert_eq!(answer.headers()["sec-websocket-protocol"], "foxglove.sdk.v1");
    Ok(socket)
}

/// A viewer, with the channels that the bridge has told it of.
struct Viewer {
    socket: Socket,
    channels: Vec<Value>,
}

/// A message that came: number of the subscription, time (ns since 1970), payload.
struct Frame {
    subscription: u32,
    wall_time_ns: u64,
    payload: Vec<u8>,
}

impl Viewer {
    async fn new(address: &str) -> Self {
        Self::with_room(address, None).await
    }

    async fn with_room(address: &str, room: Option<u32>) -> Self {
        let socket = connect(address, &[], room).await.unwrap();
        let mut viewer = Self { socket, channels: Vec::new() };
        let info = viewer.text().await;
        assert_eq!((&info["op"], &info["capabilities"]), (&json!("serverInfo"), &json!([])));
        let mut advertised = viewer.text().await;
        assert_eq!(advertised["op"], "advertise");
        let Value::Array(channels) = advertised["channels"].take() else { panic!("{advertised}") };
        viewer.channels = channels;
        viewer
    }

    async fn next(&mut self) -> Message {
        timeout(LIMIT, self.socket.next()).await.expect("silence").expect("closed").unwrap()
    }

    async fn text(&mut self) -> Value {
        loop {
            if let Message::Text(text) = self.next().await {
                return serde_json::from_str(&text).unwrap();
            }
        }
    }

    async fn frame(&mut self) -> Frame {
        loop {
            let Message::Binary(bytes) = self.next().await else { continue };
            assert_eq!(bytes[0], 1, "a frame that is no message");
            return Frame {
                subscription: u32::from_le_bytes(bytes[1..5].try_into().unwrap()),
                wall_time_ns: u64::from_le_bytes(bytes[5..13].try_into().unwrap()),
                payload: bytes[13..].to_vec(),
            };
        }
    }

    async fn say(&mut self, request: Value) {
        self.socket.send(Message::text(request.to_string())).await.unwrap();
    }

    fn channel(&self, topic: &str) -> &Value {
        self.channels.iter().find(|channel| channel["topic"] == topic).unwrap()
    }

    /// The layout of a topic, by what was advertised.
    fn layout(&self, topic: &str) -> Layout {
        let channel = self.channel(topic);
        assert_eq!(channel["encoding"], "cdr");
        let text = |key: &str| channel[key].as_str().unwrap();
        Layout::parse(text("schemaName"), text("schemaEncoding"), text("schema")).unwrap()
    }

    async fn subscribe(&mut self, topics: &[&str]) {
        let wishes: Vec<Value> = topics
            .iter()
            .enumerate()
            .map(|(id, topic)| json!({ "id": id, "channelId": self.channel(topic)["id"] }))
            .collect();
        self.say(json!({ "op": "subscribe", "subscriptions": wishes })).await;
    }
}

/// Samples in the order in which they came.
#[derive(Default)]
struct Seen {
    count: usize,
    holes: u64,
    offset_ns: Option<u64>,
    newest: Option<(u64, u64, u64)>,
}

impl Seen {
    fn take(&mut self, layout: &Layout, frame: &Frame) {
        let body = layout.body(&frame.payload).unwrap();
        let field = |name: &str| layout.unsigned(name, body).unwrap();
        let now = (field("incarnation"), field("sequence"), field("tick"));
        if let Some((incarnation, sequence, tick)) = self.newest.replace(now) {
            assert_eq!(now.0, incarnation, "acquisition was started anew");
            assert!(now.1 > sequence && now.2 > tick, "{now:?} after {sequence}, {tick}");
            self.holes += now.1 - sequence - 1;
        }
        let offset_ns = frame.wall_time_ns - field("time_ns");
        assert_eq!(*self.offset_ns.get_or_insert(offset_ns), offset_ns);
        self.count += 1;
    }
}

/// Takes samples until there are so many.
async fn take_samples(viewer: &mut Viewer, seen: &mut Seen, count: usize) {
    let layout = viewer.layout("sample");
    while seen.count < count {
        let frame = viewer.frame().await;
        if frame.subscription == 0 {
            seen.take(&layout, &frame);
        }
    }
}

/// The number before these words in a line.
fn number_before(line: &str, words: &str) -> u64 {
    let (before, _) = line.split_once(words).unwrap_or_else(|| panic!("{words} in {line}"));
    before.rsplit(' ').next().unwrap().parse().unwrap()
}

/// A viewer decodes by the advertised schema, and what it does not get is counted.
async fn a_viewer_gets_every_sample(bridge: &Bridge) {
    let mut viewer = Viewer::new(&bridge.address).await;
    let advertised: Vec<&str> =
        viewer.channels.iter().map(|channel| channel["topic"].as_str().unwrap()).collect();
    let topics: Vec<&str> = TOPICS.iter().map(|topic| topic.name).collect();
    assert_eq!(advertised, topics);
    assert!(viewer.layout("sample").matches::<ipc_types::Sample>());

    // What happened before it came: the topic's history.
    let events = event_topic(Process::Watchdog).unwrap().topic.name;
    viewer.subscribe(&["sample", events]).await;
    let layout = viewer.layout("sample");
    let (mut seen, mut events) = (Seen::default(), 0);
    while seen.count < SAMPLES {
        let frame = viewer.frame().await;
        match frame.subscription {
            0 => seen.take(&layout, &frame),
            _ => events += 1,
        }
    }
    assert!(events > 0, "the events before it came are missing");
    viewer.say(json!({ "op": "unsubscribe", "subscriptionIds": [0, 1] })).await;
    viewer.socket.close(None).await.unwrap();
    let line = bridge.line("viewer 1 ", " left: ");
    let counted =
        number_before(&line, " lost before the bridge") + number_before(&line, " dropped");
    assert!(number_before(&line, " messages sent") >= SAMPLES as u64, "{line}");
    assert!(seen.holes <= counted, "{} holes, and the bridge says: {line}", seen.holes);
}

/// One that does not read is cut off, with its losses counted; another one gets its samples all the
/// while, and one that vanishes disturbs nobody.
async fn a_viewer_that_does_not_read_holds_nobody_up(bridge: &Bridge) {
    let mut slow = Viewer::with_room(&bridge.address, Some(NARROW)).await;
    let all: Vec<&str> = TOPICS.iter().map(|topic| topic.name).collect();
    slow.subscribe(&all).await;
    drop(Viewer::new(&bridge.address).await);

    let mut quick = Viewer::new(&bridge.address).await;
    quick.subscribe(&["sample"]).await;
    let mut seen = Seen::default();
    while bridge.find("viewer 2 ", " was disconnected, it does not listen: ").is_none() {
        let more = seen.count + 200;
        take_samples(&mut quick, &mut seen, more).await;
    }
    let line = bridge.line("viewer 2 ", " was disconnected");
    assert!(number_before(&line, " dropped") > 0, "{line}");
    quick.socket.close(None).await.unwrap();
    let line = bridge.line("viewer 4 ", " left: ");
    let counted =
        number_before(&line, " lost before the bridge") + number_before(&line, " dropped");
    assert!(seen.count > SAMPLES && seen.holes <= counted, "{}: {line}", seen.holes);
}

/// Requests that must not be served.
async fn strangers_are_refused(bridge: &Bridge) {
    for (headers, code) in [
        (("origin", "https://evil.example"), 403),
        (("origin", "null"), 403),
        (("host", "evil.example"), 421),
        (("sec-websocket-protocol", "chat"), 400),
    ] {
        match connect(&bridge.address, &[headers], None).await {
            Err(Error::Http(answer)) => assert_eq!(answer.status(), code, "{headers:?}"),
            other => panic!("{headers:?}: {other:?}"),
        }
    }
    bridge.line("https://evil.example", "--origin admits it");
    let mut viewer = Viewer::new(&bridge.address).await;
    viewer.say(json!({ "op": "setParameters", "parameters": [] })).await;
    let told = viewer.text().await;
    assert_eq!((&told["op"], &told["level"]), (&json!("status"), &json!(2)), "{told}");
}

/// Fewer messages of fewer topics, on request.
async fn a_bridge_skips_what_it_is_told_to(bridge: &Bridge) {
    let mut viewer = Viewer::new(&bridge.address).await;
    assert_eq!(viewer.channels.len(), 1);
    viewer.subscribe(&["sample"]).await;
    let (layout, mut ticks) = (viewer.layout("sample"), Vec::new());
    for _ in 0..4 {
        let frame = viewer.frame().await;
        ticks.push(layout.unsigned("tick", layout.body(&frame.payload).unwrap()).unwrap());
    }
    // The period is 100 ticks, and counts from the first message.
    assert!(ticks[3] - ticks[0] >= 250, "{ticks:?}");
}

/// What the client of viewers makes of it, with a decoder of theirs.
fn the_viewers_own_client_decodes_it(bridge: &Bridge) {
    let Ok(modules) = std::env::var(NODE_MODULES) else {
        eprintln!("SKIPPED: {NODE_MODULES} names no folder with the viewers' client");
        return;
    };
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/stand_in/viewer.js");
    let address = format!("ws://{}", bridge.address);
    let mut node = Command::new("node");
    node.arg(script).args([&address, &SAMPLES.to_string()]).env("NODE_PATH", modules);
    let output = node.output().unwrap();
    assert!(output.status.success(), "{}", told(&output));
    let all: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(all["channels"].as_u64(), Some(TOPICS.len() as u64));
    for topic in ["sample", "command", "token", "card_scan", "loss"] {
        assert!(all["decoded"][topic].as_u64() > Some(0), "{topic}: {}", all["decoded"]);
    }
    let samples = all["samples"].as_array().unwrap();
    assert!(samples.iter().all(|sample| sample[3] == samples[0][3] && sample[2].is_number()));
    let sequence = |sample: &Value| sample[0].as_u64().unwrap();
    let first_to_last = sequence(&samples[SAMPLES - 1]) - sequence(&samples[0]);
    let holes = first_to_last - (SAMPLES as u64 - 1);
    assert!(samples.windows(2).all(|pair| sequence(&pair[1]) > sequence(&pair[0])));
    // It ends amid the stream: whether it left or broke off is a race.
    let line = bridge.line("viewer 6 ", " dropped");
    let counted =
        number_before(&line, " lost before the bridge") + number_before(&line, " dropped");
    assert!(holes <= counted, "{holes} holes, and the bridge says: {line}");
}

#[test]
fn viewers_attach_live_and_never_hold_the_rig_up() {
    let rig = TestRig::patient("bridge-foxglove");
    rig.ok(["up", "--simulate"]);
    let before = rig.launcher_status();
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();

    let mut bridge = Bridge::start(&rig, &["foxglove", "--port", "0"]);
    runtime.block_on(async {
        a_viewer_gets_every_sample(&bridge).await;
        a_viewer_that_does_not_read_holds_nobody_up(&bridge).await;
        strangers_are_refused(&bridge).await;
    });
    the_viewers_own_client_decodes_it(&bridge);
    let port = bridge.address.rsplit(':').next().unwrap().to_owned();
    let taken = rig.run(["bridge", "foxglove", "--port", &port]);
    assert_eq!(taken.status.code(), Some(1), "{}", told(&taken));
    assert!(String::from_utf8_lossy(&taken.stderr).contains("--port"), "{}", told(&taken));
    let unknown = rig.run(["bridge", "foxglove", "--topic", "sampel"]);
    assert!(String::from_utf8_lossy(&unknown.stderr).contains("sampel"), "{}", told(&unknown));

    let every = ["foxglove", "--port", "0", "--topic", "sample", "--every", "0.05"];
    let mut thin = Bridge::start(&rig, &every);
    runtime.block_on(a_bridge_skips_what_it_is_told_to(&thin));
    kill(thin.pid(), Signal::TERM);
    assert_eq!(thin.exit_code(), Some(0));
    thin.line(&format!("messages of {}", SAMPLE.topic.name), " were skipped by --every");

    // No process of the rig was restarted, and the bridge ends with the rig.
    let restarts = |status: &launch::Status| -> Vec<_> {
        status
            .units
            .iter()
            .map(|unit| (unit.name.clone(), unit.process.as_ref().map(|it| it.pid)))
            .collect()
    };
    let (before, after) = (restarts(&before), restarts(&rig.launcher_status()));
    assert_eq!(format!("{before:?}"), format!("{after:?}"));
    rig.ok(["down"]);
    bridge.line("went down", "");
    assert_eq!(bridge.exit_code(), Some(1));
    assert_eq!(rig.processes(), Vec::<i32>::new());
    assert_eq!(rig.remains(), Vec::<PathBuf>::new());
}

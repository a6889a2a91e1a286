//! The web server: who may connect, and one task for each viewer.

use std::collections::BTreeSet;
use std::net::{SocketAddr, TcpListener};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use anyhow::Context as _;
use axum::Router;
use axum::body::Bytes;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::ws::{CloseFrame, Message, Utf8Bytes, WebSocket, WebSocketUpgrade, close_code};
use axum::extract::{ConnectInfo, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use futures_util::stream::{SplitSink, SplitStream};
use futures_util::{SinkExt as _, StreamExt as _};
use tokio::time::{interval, timeout};
use web_console::{computer_name, is_own_host};

use super::origin::is_admitted;
use super::protocol::SUBPROTOCOLS;
use super::viewer::{Outbox, Viewer};
use crate::lock;

/// Most viewers at a time.
const VIEWERS: usize = 16;
/// Longest request (bytes).
const LONGEST: usize = 1 << 16;
/// Messages that are handed to the line at once.
const BATCH: usize = 64;
/// A viewer that does not take a batch within this time is gone.
const SEND_LIMIT: Duration = Duration::from_secs(10);
/// Period of the questions whether a viewer is still there.
const PING: Duration = Duration::from_secs(20);
/// A viewer that says nothing for so long, not even that it is still there, is gone.
const SILENCE_LIMIT: Duration = Duration::from_secs(60);
/// Refused origins that are told.
const ORIGINS_TOLD: usize = 16;

/// What all tasks know.
pub(crate) struct Site {
    /// Viewers that are there.
    viewers: Mutex<Vec<Arc<Viewer>>>,
    numbers: AtomicU64,
    /// Name of this computer.
    computer: String,
    /// Origins that were named.
    origins: Vec<String>,
    refused: Mutex<BTreeSet<String>>,
    /// The first messages to a viewer.
    welcome: [Utf8Bytes; 2],
    topics: usize,
}

impl Site {
    /// A site without viewers; `welcome` are the first messages to each.
    pub(crate) fn new(origins: &[String], welcome: [String; 2], topics: usize) -> Self {
        Self {
            viewers: Mutex::default(),
            numbers: AtomicU64::new(0),
            computer: computer_name(),
            origins: origins.to_vec(),
            refused: Mutex::default(),
            welcome: welcome.map(Utf8Bytes::from),
            topics,
        }
    }

    /// Does something with each viewer that is there.
    pub(crate) fn each(&self, does: impl FnMut(&Arc<Viewer>)) {
        lock(&self.viewers).iter().for_each(does);
    }

    /// Takes a viewer in; `None` where there are too many.
    fn enter(&self, from: String) -> Option<(Arc<Viewer>, Outbox)> {
        let mut viewers = lock(&self.viewers);
        if viewers.len() >= VIEWERS {
            return None;
        }
        let number = self.numbers.fetch_add(1, Ordering::Relaxed) + 1;
        let (viewer, outbox) = Viewer::new(number, from, self.topics);
        let viewer = Arc::new(viewer);
        viewers.push(Arc::clone(&viewer));
        Some((viewer, outbox))
    }

    fn leave(&self, viewer: &Arc<Viewer>) {
        lock(&self.viewers).retain(|other| !Arc::ptr_eq(other, viewer));
    }

    /// Whether a request may become a viewer.
    fn admit(&self, headers: &HeaderMap) -> Result<(), (StatusCode, String)> {
        let text_of = |name| headers.get(name).map(|value| value.to_str().unwrap_or("?"));
        if !is_own_host(text_of(header::HOST).unwrap_or_default(), &self.computer) {
            let text = "this bridge does not answer to that name; use its address\n";
            return Err((StatusCode::MISDIRECTED_REQUEST, text.to_owned()));
        }
        let origin = text_of(header::ORIGIN);
        if !is_admitted(origin, &self.origins) {
            let origin: String = origin.unwrap_or_default().chars().take(200).collect();
            let mut refused = lock(&self.refused);
            if refused.len() < ORIGINS_TOLD && refused.insert(origin.clone()) {
                say!("a page of {origin:?} was refused; --origin admits it");
            }
            let text = "a page of another site; a bridge that is started with --origin admits it\n";
            return Err((StatusCode::FORBIDDEN, text.to_owned()));
        }
        Ok(())
    }
}

/// Serves until the process ends.
///
/// # Errors
/// If there is no thread for it.
pub(crate) fn start(site: Arc<Site>, listener: TcpListener) -> anyhow::Result<JoinHandle<()>> {
    listener.set_nonblocking(true)?;
    let serve = move || {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        runtime.block_on(async {
            let listener = tokio::net::TcpListener::from_std(listener)?;
            let router = Router::new().fallback(socket).with_state(site);
            axum::serve(listener, router.into_make_service_with_connect_info::<SocketAddr>()).await
        })
    };
    let run = move || {
        let served: std::io::Result<()> = serve();
        if let Err(error) = served {
            say!("the web server: {error}");
        }
    };
    std::thread::Builder::new().name("web".to_owned()).spawn(run).context("starting a thread")
}

async fn socket(
    State(site): State<Arc<Site>>,
    ConnectInfo(from): ConnectInfo<SocketAddr>,
    headers: HeaderMap,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Response {
    if let Err(refusal) = site.admit(&headers) {
        return refusal.into_response();
    }
    let Ok(upgrade) = upgrade else {
        let text = "expected a viewer: in Foxglove or Lichtblick, \"Open connection\", \
                    \"Foxglove WebSocket\", and this address with ws:// in place of http://\n";
        return (StatusCode::UPGRADE_REQUIRED, text).into_response();
    };
    let upgrade = upgrade.protocols(SUBPROTOCOLS);
    if upgrade.selected_protocol().is_none() {
        let text = format!("expected the protocol {}\n", SUBPROTOCOLS.join(" or "));
        return (StatusCode::BAD_REQUEST, text).into_response();
    }
    upgrade
        .max_message_size(LONGEST)
        .max_frame_size(LONGEST)
        .on_upgrade(move |socket| serve(socket, from, site))
}

/// Serves a viewer until it leaves, breaks a rule, or does not listen.
async fn serve(socket: WebSocket, from: SocketAddr, site: Arc<Site>) {
    let (mut writing, mut reading) = socket.split();
    let Some((viewer, mut outbox)) = site.enter(from.to_string()) else {
        close(&mut writing, &format!("{VIEWERS} viewers are there, which is the most")).await;
        return;
    };
    let (number, from) = (viewer.number, &viewer.from);
    say!("viewer {number} ({from}) is there");
    let end = tokio::select! {
        end = listen(&mut reading, &viewer) => end,
        end = talk(&mut writing, &site.welcome, &mut outbox) => end,
    };
    site.leave(&viewer);
    match end {
        Ok(()) => say!("viewer {number} ({from}) left: {}", viewer.counts()),
        Err(why) => {
            say!("viewer {number} ({from}) was disconnected, {why}: {}", viewer.counts());
            close(&mut writing, why).await;
        }
    }
}

async fn close(writing: &mut SplitSink<WebSocket, Message>, why: &str) {
    let reason = Utf8Bytes::from(why.to_owned());
    let frame = Message::Close(Some(CloseFrame { code: close_code::POLICY, reason }));
    let _sent = timeout(SEND_LIMIT, writing.send(frame)).await;
}

/// Takes its requests.
///
/// # Errors
/// Why the connection is closed from here.
async fn listen(reading: &mut SplitStream<WebSocket>, viewer: &Viewer) -> Result<(), &'static str> {
    loop {
        let Ok(received) = timeout(SILENCE_LIMIT, reading.next()).await else {
            return Err("it is silent");
        };
        match received {
            Some(Ok(Message::Text(text))) => viewer.request(Ok(text.as_str()))?,
            Some(Ok(Message::Binary(_))) => {
                viewer.request(Err("this bridge only sends: it takes no messages"))?;
            }
            Some(Ok(Message::Ping(_) | Message::Pong(_))) => {}
            Some(Ok(Message::Close(_)) | Err(_)) | None => return Ok(()),
        }
    }
}

/// Sends what waits for it.
///
/// # Errors
/// Why the connection is closed from here.
async fn talk(
    writing: &mut SplitSink<WebSocket, Message>,
    welcome: &[Utf8Bytes],
    outbox: &mut Outbox,
) -> Result<(), &'static str> {
    for text in welcome {
        send(writing, [Message::Text(text.clone())]).await?;
    }
    let mut ping = interval(PING);
    let mut batch = Vec::with_capacity(BATCH);
    loop {
        tokio::select! {
            Some(text) = outbox.texts.recv() => send(writing, [Message::Text(text)]).await?,
            count = outbox.messages.recv_many(&mut batch, BATCH) => {
                if count == 0 {
                    return Ok(());
                }
                send(writing, batch.drain(..).map(Message::Binary)).await?;
            }
            _ = ping.tick() => send(writing, [Message::Ping(Bytes::new())]).await?,
        }
    }
}

async fn send(
    writing: &mut SplitSink<WebSocket, Message>,
    messages: impl IntoIterator<Item = Message>,
) -> Result<(), &'static str> {
    let all = async {
        for message in messages {
            writing.feed(message).await?;
        }
        writing.flush().await
    };
    match timeout(SEND_LIMIT, all).await {
        Ok(Ok(())) => Ok(()),
        Ok(Err(_)) => Err("the connection broke"),
        Err(_) => Err("it does not listen"),
    }
}

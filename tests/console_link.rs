//! The console from a second computer: pages reach it over a link, and the rig does not depend on
//! the link. Two network namespaces take the place of two computers.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;
#[path = "common/console_client.rs"]
mod console_client;

use std::fs::File;
use std::os::fd::AsFd as _;
use std::process::Command;
use std::time::Duration;

use futures_util::SinkExt as _;
use ipc_types::{
    EXPERIMENT_COMMANDS, Event, EventKind, ExperimentAnswer, ExperimentRequest, SCANNER_KEY,
    ScannerPulse,
};
use recording::mcap_read::Recording;
use rustix::thread::{LinkNameSpaceType, move_into_link_name_space};
use serde_json::{Value, json};
use tokio::time::timeout;
use tokio_tungstenite::connect_async;
use tokio_tungstenite::tungstenite::Message;

use common::playing::messages;
use common::{TestRig, wait_for};
use console_client::{LIMIT, Socket, address, next};

const RIG_ADDRESS: &str = "10.213.77.1";
const PAGE_ADDRESS: &str = "10.213.77.2";
/// How far the clock of the second computer is ahead (ms).
const AHEAD_MS: f64 = 1_234_500.0;

/// Two network namespaces with a cable between them; removed in any case.
struct Link {
    rig: String,
    page: String,
}

fn ip(arguments: &str) -> Result<(), String> {
    let output = Command::new("ip")
        .args(arguments.split_whitespace())
        .output()
        .map_err(|error| format!("ip: {error}"))?;
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    if output.status.success() { Ok(()) } else { Err(format!("ip {arguments}: {told}")) }
}

impl Link {
    /// `Err` where this machine or user may have none.
    fn new() -> Result<Self, String> {
        let pid = std::process::id();
        let link = Self { rig: format!("frr{pid}"), page: format!("frp{pid}") };
        let (rig, page) = (&link.rig, &link.page);
        ip(&format!("netns add {rig}"))?;
        ip(&format!("netns add {page}"))?;
        ip(&format!("link add {rig} netns {rig} type veth peer name {page} netns {page}"))?;
        for (space, address) in [(rig, RIG_ADDRESS), (page, PAGE_ADDRESS)] {
            ip(&format!("-n {space} address add {address}/24 dev {space}"))?;
            ip(&format!("-n {space} link set lo up"))?;
            ip(&format!("-n {space} link set {space} up"))?;
        }
        Ok(link)
    }

    /// Connects or cuts the cable.
    fn set(&self, state: &str) {
        ip(&format!("-n {0} link set {0} {state}", self.rig)).unwrap();
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        for space in [&self.rig, &self.page] {
            let _ = ip(&format!("netns del {space}"));
        }
    }
}

/// Moves this thread, and the processes that it will start, into a network namespace.
fn enter(space: &str) {
    let file = File::open(format!("/run/netns/{space}")).unwrap();
    move_into_link_name_space(file.as_fd(), Some(LinkNameSpaceType::Network)).unwrap();
}

/// A page on the second computer.
struct Page {
    socket: Socket,
    id: u64,
}

impl Page {
    async fn open(host: &str, token: &str) -> Self {
        let address = format!("ws://{host}/ws?page=operator");
        let opened = timeout(LIMIT, connect_async(address)).await.expect("no connection");
        let mut page = Self { socket: opened.unwrap().0, id: 0 };
        assert_eq!(page.ask(json!({"do": "hello", "token": token})).await["ok"], true);
        page
    }

    async fn send(&mut self, request: Value) -> u64 {
        self.id += 1;
        let text = json!({"id": self.id, "request": request}).to_string();
        self.socket.send(Message::text(text)).await.unwrap();
        self.id
    }

    /// The next message that fits; answers those of the clock, as a page does.
    async fn next(&mut self, fits: impl Fn(&Value) -> bool) -> Value {
        loop {
            let value = next(&mut self.socket, |_| true).await.expect("closed");
            if value["type"] == "clock" {
                let page_ms = runtime::clock::now_ns() as f64 * 1e-6 + AHEAD_MS;
                let server_ms = &value["server_ms"];
                self.send(json!({"do": "echo", "server_ms": server_ms, "page_ms": page_ms})).await;
            }
            if fits(&value) {
                return value;
            }
        }
    }

    async fn ask(&mut self, request: Value) -> Value {
        let id = self.send(request).await;
        self.next(|value| value["type"] == "answer" && value["id"] == id).await["answer"].take()
    }

    /// Takes control, starts a movement of 20 s, and presses the key 5 three times; when it did
    /// (ns, CLOCK_MONOTONIC).
    async fn start(&mut self) -> Vec<u64> {
        assert_eq!(self.ask(json!({"do": "take-control"})).await["ok"], true);
        let entries = json!({"segments.0.duration_s": "20"});
        let (protocol, scanner) = ("guided-1hz", "key");
        let setup = json!({"do": "build", "protocol": protocol, "entries": entries,
            "scanner": scanner});
        let built = self.ask(setup).await;
        assert_eq!(built["ok"], true, "{built}");
        let started = self.ask(json!({"do": "start", "build": built["data"]["build"]})).await;
        assert_eq!(started["ok"], true, "{started}");
        // The console knows this page's clock by now.
        self.next(|value| value["type"] == "clock").await;
        let mut pressed = Vec::new();
        for _ in 0..3 {
            let at_ns = runtime::clock::now_ns();
            let page_ms = at_ns as f64 * 1e-6 + AHEAD_MS;
            let counted = self.ask(json!({"do": "pulse", "page_ms": page_ms})).await;
            // A rig that has tripped meanwhile counts none.
            if counted["ok"] != true {
                return pressed;
            }
            pressed.push(at_ns);
        }
        // By another clock it was pressed twenty minutes ago.
        let page_ms = runtime::clock::now_ns() as f64 * 1e-6;
        let refused = self.ask(json!({"do": "pulse", "page_ms": page_ms})).await;
        assert_eq!(refused["ok"], false, "{refused}");
        pressed
    }
}

/// Runs on the second computer.
fn over_there<T: Send>(space: &str, work: impl AsyncFnOnce() -> T + Send) -> T {
    std::thread::scope(|scope| {
        let thread = scope.spawn(|| {
            enter(space);
            let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
            runtime.unwrap().block_on(work())
        });
        thread.join().unwrap()
    })
}

#[test]
fn a_page_on_a_second_computer_controls_a_rig_that_needs_no_link() {
    let link = match Link::new() {
        Ok(link) => link,
        Err(error) => {
            println!("SKIPPED: two network namespaces cannot be made here: {error}");
            return;
        }
    };
    enter(&link.rig);
    let rig = TestRig::patient("console-link");
    let console = format!("{RIG_ADDRESS}:0");
    let absolute = rig.absolute_rig("hydrostatic");
    rig.ok(["up", "--simulate", "--rig", &absolute, "--console", &console]);
    let (host, token) = address(&rig);
    let (host, token) = (host.as_str(), token.as_str());
    assert!(host.starts_with(RIG_ADDRESS), "{host}");
    let file = rig.path("link.mcap");
    rig.ok(["rec", "start", file.to_str().unwrap()]);
    let domain = runtime::Domain::observe(rig.name()).unwrap();
    let node = domain.node("asker").unwrap();
    let running = || -> bool {
        let asked: Result<ExperimentAnswer, _> =
            runtime::call(&node, &EXPERIMENT_COMMANDS, &ExperimentRequest::Status, LIMIT);
        asked.is_ok_and(|status| status.running)
    };
    let mut outlived = false;
    let mut pressed = Vec::new();
    // A loaded host may trip the rig, rightly: that says nothing of the link.
    for _ in 0..4 {
        rig.power_up();
        pressed
            .extend(over_there(&link.page, async || Page::open(host, token).await.start().await));
        // The page is gone by now, and its computer soon after.
        link.set("down");
        std::thread::sleep(Duration::from_secs(6));
        outlived = running();
        link.set("up");
        let found = over_there(&link.page, async || {
            let mut page = Page::open(host, token).await;
            // Long enough for the estimate of its clock to be recorded.
            let from = std::time::Instant::now();
            while from.elapsed() < Duration::from_secs(12) {
                page.next(|value| value["type"] == "clock").await;
            }
            page.next(|value| value["type"] == "state").await
        });
        assert!(found["rig"].is_object(), "{found}");
        if outlived {
            break;
        }
        rig.run(["disarm"]);
    }
    assert!(outlived, "the protocol ended with the link: {}", rig.why("console"));
    wait_for(LIMIT, || !running());
    rig.ok(["rec", "stop"]);
    let recording = Recording::open(&file).unwrap();
    let events: Vec<Event> = messages(&recording, "event/console");
    let clocks: Vec<&Event> =
        events.iter().filter(|event| event.kind == EventKind::ClockMeasured.code()).collect();
    assert!(!clocks.is_empty());
    let keys: Vec<ScannerPulse> = messages(&recording, SCANNER_KEY.topic.name);
    assert!(!pressed.is_empty() && keys.len() == pressed.len(), "{keys:?}, {pressed:?}");
    for (key, pressed_ns) in keys.iter().zip(pressed) {
        let error_s = (key.at_ns as f64 - pressed_ns as f64) * 1e-9;
        assert!(error_s.abs() < 0.5, "{error_s} s of {AHEAD_MS} ms");
    }
    for clock in clocks {
        // Off by half of the round trip at most.
        let error_s = clock.b - AHEAD_MS * 1e-3;
        assert!(error_s.abs() <= 0.5 * clock.c + 1e-6, "{error_s} s, round trip {} s", clock.c);
    }
    rig.down();
}

//! The console's WebSocket against messages that no page sends: nothing ends, nothing moves.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;
#[path = "common/console_client.rs"]
mod console_client;

use futures_util::{SinkExt as _, StreamExt as _};
use serde_json::Value;
use tokio::time::timeout;
use tokio_tungstenite::connect_async;
use tokio_tungstenite::tungstenite::client::IntoClientRequest as _;
use tokio_tungstenite::tungstenite::{Error, Message};

use common::TestRig;
use common::mutated::Numbers;
use console_client::{LIMIT, Socket, address, next};

const MESSAGES: usize = 10_000;
/// Below what a page may send at once.
const EACH: usize = 190;

async fn connect(host: &str, headers: &[(&'static str, &str)]) -> Result<Socket, Error> {
    let mut request = format!("ws://{host}/ws?page=operator").into_client_request().unwrap();
    for (name, value) in headers {
        request.headers_mut().insert(*name, value.parse().unwrap());
    }
    Ok(connect_async(request).await?.0)
}

async fn ask(socket: &mut Socket, id: u64, request: &str) -> Value {
    let text = format!("{{\"id\": {id}, \"request\": {request}}}");
    socket.send(Message::text(text)).await.unwrap();
    let answer = next(socket, |value| value["type"] == "answer" && value["id"] == id).await;
    answer.expect("closed")["answer"].clone()
}

/// A message as a broken or hostile page may send it.
fn hostile(numbers: &mut Numbers) -> Message {
    let requests = [
        r#"{"id":1,"request":{"do":"verb","verb":"reset"}}"#,
        r#"{"id":1,"request":{"do":"verb","verb":"arm"}}"#,
        r#"{"id":1,"request":{"do":"verb","verb":"enable"}}"#,
        r#"{"id":1,"request":{"do":"initialise"}}"#,
        r#"{"id":1,"request":{"do":"start","build":"0000000000000000"}}"#,
        r#"{"id":1,"request":{"do":"build","protocol":"/etc/passwd","entries":{"x":"1"}}}"#,
        r#"{"id":1,"request":{"do":"record","file":"/dev/sda"}}"#,
        r#"{"id":1,"request":{"do":"echo","server_ms":-1e308,"page_ms":1e308}}"#,
        r#"{"id":18446744073709551615,"request":{"do":"take-control"}}"#,
    ];
    let mut text: Vec<char> = requests[numbers.below(requests.len())].chars().collect();
    match numbers.below(5) {
        // As it is: this page has no token.
        0 => {}
        1 => text.truncate(numbers.below(text.len())),
        2 => {
            let at = numbers.below(text.len());
            text[at] = char::from_u32(numbers.below(0x300) as u32).unwrap_or('\u{fffd}');
        }
        3 => {
            let part = text.clone();
            text.splice(0..0, part);
        }
        _ => {
            let (at, length) = (numbers.below(text.len()), numbers.below(3000));
            text.splice(at..at, std::iter::repeat_n('[', length));
        }
    }
    Message::text(text.into_iter().collect::<String>())
}

/// Sends hostile messages, over as many connections as it takes.
async fn send_hostile(host: &str) {
    let mut numbers = Numbers(20_261_126);
    let mut sent = 0;
    while sent < MESSAGES {
        let (mut writing, mut reading) = connect(host, &[]).await.unwrap().split();
        let read = tokio::spawn(async move { while let Some(Ok(_)) = reading.next().await {} });
        for _ in 0..EACH.min(MESSAGES - sent) {
            writing.send(hostile(&mut numbers)).await.unwrap();
            sent += 1;
        }
        writing.close().await.unwrap();
        timeout(LIMIT, read).await.expect("the console does not close").unwrap();
    }
}

#[test]
fn hostile_messages_end_and_move_nothing() {
    let rig = TestRig::patient("console-socket");
    rig.ok(["up", "--simulate", "--console", "127.0.0.1:0"]);
    let (host, token) = address(&rig);
    let pid = |rig: &TestRig| rig.launcher_status().unit("console").unwrap().process.unwrap().pid;
    let before = pid(&rig);
    let state = |rig: &TestRig| {
        let status: Value = serde_json::from_str(&rig.ok(["status", "--json"])).unwrap();
        status["watchdog"]["state"].as_str().unwrap().to_owned()
    };
    let faulted = state(&rig);
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        send_hostile(&host).await;

        // Endless messages: the connection is closed, and why.
        let mut socket = connect(&host, &[]).await.unwrap();
        for _ in 0..5_000 {
            if socket.send(Message::text("{}")).await.is_err() {
                break;
            }
        }
        assert!(next(&mut socket, |_| false).await.is_none());
        // One that is too long.
        let mut socket = connect(&host, &[]).await.unwrap();
        let _sent = socket.send(Message::text("x".repeat(1 << 20))).await;
        assert!(next(&mut socket, |_| false).await.is_none());

        // A page of another site, and a name that was made to point here.
        for headers in [("origin", "http://evil.example"), ("host", "evil.example")] {
            let refused = connect(&host, &[headers]).await;
            assert!(matches!(refused, Err(Error::Http(_))), "{headers:?}");
        }

        // A wrong token: three times, then the connection is closed.
        let mut socket = connect(&host, &[]).await.unwrap();
        for id in 1..=3 {
            let answer = ask(&mut socket, id, r#"{"do": "hello", "token": "wrong"}"#).await;
            assert_eq!(answer["ok"], false);
        }
        assert!(next(&mut socket, |_| false).await.is_none());

        // And who has the right one is served as ever.
        let mut socket = connect(&host, &[]).await.unwrap();
        let hello = format!("{{\"do\": \"hello\", \"token\": \"{token}\"}}");
        assert_eq!(ask(&mut socket, 1, &hello).await["ok"], true);
        assert_eq!(ask(&mut socket, 2, r#"{"do": "refresh"}"#).await["ok"], true);
    });
    assert_eq!(pid(&rig), before, "the console was started again: {}", rig.why("console"));
    assert_eq!(state(&rig), faulted, "a page without the token changed the watchdog's state");
    // An emergency stop is carried out although its page is gone, and does not read what the
    // console writes to it meanwhile.
    for closes in [true, false].repeat(2) {
        runtime.block_on(async {
            let mut socket = connect(&host, &[]).await.unwrap();
            let hello = format!("{{\"do\": \"hello\", \"token\": \"{token}\"}}");
            assert_eq!(ask(&mut socket, 1, &hello).await["ok"], true);
            let estop = r#"{"id": 2, "request": {"do": "verb", "verb": "estop"}}"#;
            socket.send(Message::text(estop)).await.unwrap();
            if closes {
                socket.close(None).await.unwrap();
            }
        });
        assert!(common::wait_for(LIMIT, || state(&rig) == "tripped"), "{}", state(&rig));
        rig.ok(["reset"]);
        assert_ne!(state(&rig), "tripped");
    }
    rig.down();
}

#[test]
fn an_address_that_is_taken_is_named_and_nothing_is_left() {
    let rig = TestRig::patient("console-taken");
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let output = rig.run(["up", "--simulate", "--console", &address]);
    common::assert_refused(&rig, &output, 1, &["console", &address]);
    let output = rig.run(["up", "--simulate", "--console", "scanner-room"]);
    common::assert_refused(&rig, &output, 2, &["scanner-room"]);
}

#[test]
fn a_rig_without_a_console_says_so() {
    let rig = TestRig::patient("console-none");
    rig.up_simulated();
    let output = rig.run(["console"]);
    common::assert_told(&output, &["has no console", "farreach up --console"]);
    assert_eq!(output.status.code(), Some(1));
    rig.down();
}

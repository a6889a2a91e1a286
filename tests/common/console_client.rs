//! A program that speaks with the console as its pages do.
#![allow(clippy::unwrap_used, clippy::expect_used, unreachable_pub)]

use std::time::Duration;

use futures_util::StreamExt as _;
use serde_json::Value;
use tokio::net::TcpStream;
use tokio::time::timeout;
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::{MaybeTlsStream, WebSocketStream};

use crate::common::TestRig;

pub const LIMIT: Duration = Duration::from_secs(20);

pub type Socket = WebSocketStream<MaybeTlsStream<TcpStream>>;

/// Host and token of the rig's console.
pub fn address(rig: &TestRig) -> (String, String) {
    let pages: Value = serde_json::from_str(&rig.ok(["console", "--json"])).unwrap();
    let operator = pages["operator"].as_str().unwrap();
    let (host, token) = operator.strip_prefix("http://").unwrap().split_once("/#token=").unwrap();
    (host.to_owned(), token.to_owned())
}

/// The next message that fits; `None` once the connection is closed.
pub async fn next(socket: &mut Socket, fits: impl Fn(&Value) -> bool) -> Option<Value> {
    timeout(LIMIT, async {
        while let Some(Ok(message)) = socket.next().await {
            if let Message::Text(text) = message {
                let value: Value = serde_json::from_str(&text).unwrap();
                if fits(&value) {
                    return Some(value);
                }
            }
        }
        None
    })
    .await
    .expect("the console is silent")
}

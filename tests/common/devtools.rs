//! The debugging protocol of Chromium: JSON over a WebSocket.
#![allow(unreachable_pub)]

use futures_util::{SinkExt as _, StreamExt as _};
use serde_json::{Value, json};
use tokio::net::TcpStream;
use tokio::sync::Mutex;
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::{MaybeTlsStream, WebSocketStream, connect_async};

/// A connection to the browser or to one of its pages. No events are asked for.
pub struct Devtools(Mutex<Connection>);

struct Connection {
    socket: WebSocketStream<MaybeTlsStream<TcpStream>>,
    /// Commands sent.
    sent: u64,
}

impl Devtools {
    /// Connects to `address` (`ws://…`).
    pub async fn connect(address: &str) -> Self {
        let (socket, _answer) = connect_async(address).await.unwrap();
        Self(Mutex::new(Connection { socket, sent: 0 }))
    }

    /// Sends a command of the protocol and waits for its result.
    ///
    /// # Errors
    ///
    /// What the browser says where it refuses the command.
    pub async fn call(&self, method: &str, parameters: Value) -> Result<Value, String> {
        let mut connection = self.0.lock().await;
        connection.sent += 1;
        let id = connection.sent;
        let command = json!({"id": id, "method": method, "params": parameters}).to_string();
        connection.socket.send(Message::text(command)).await.map_err(|error| error.to_string())?;
        while let Some(message) = connection.socket.next().await {
            let message = message.map_err(|error| error.to_string())?;
            let Ok(text) = message.to_text() else { continue };
            let Ok(mut answer) = serde_json::from_str::<Value>(text) else { continue };
            if answer["id"] == id {
                return match answer.get("error") {
                    Some(error) => Err(error.to_string()),
                    None => Ok(answer["result"].take()),
                };
            }
        }
        Err(format!("{method}: the browser has closed the connection"))
    }

    /// The value of an expression of JavaScript; that of a promise once it is kept.
    ///
    /// # Errors
    ///
    /// What was thrown, or what the browser says.
    pub async fn evaluate(&self, expression: &str) -> Result<Value, String> {
        let asked = json!({
            "expression": expression, "returnByValue": true, "awaitPromise": true,
        });
        let mut result = self.call("Runtime.evaluate", asked).await?;
        match result.get("exceptionDetails") {
            Some(thrown) => Err(thrown.to_string()),
            None => Ok(result["result"]["value"].take()),
        }
    }
}

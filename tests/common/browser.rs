//! A real browser: Chromium without a window, driven through its debugging port.
#![allow(dead_code, unreachable_pub)]

use std::io::{BufRead as _, BufReader};
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use data_encoding::BASE64;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};

use crate::common::Signal;
use crate::devtools::Devtools;

/// Pages are looked at so often.
const POLL: Duration = Duration::from_millis(100);
/// A page is loaded within this time.
const LOADED: Duration = Duration::from_secs(60);

/// A browser of its own for one test; ended with all its processes in any case.
pub struct Chromium {
    child: Child,
    address: String,
    _profile: tempfile::TempDir,
}

/// The browser's executable, if it is on this machine. A test that gets `None` must skip, and print
/// that.
fn executable() -> Option<PathBuf> {
    let folders = std::env::var_os("PATH")?;
    let names = ["chromium", "chromium-browser", "google-chrome"];
    let mut candidates =
        std::env::split_paths(&folders).flat_map(|folder| names.map(|name| folder.join(name)));
    candidates.find(|path| path.is_file())
}

impl Chromium {
    /// Starts the browser; `None` where there is none on this machine, which is printed.
    pub fn start() -> Option<Self> {
        let Some(executable) = executable() else {
            eprintln!("SKIPPED: Chromium is not on this machine, so the pages were not tried");
            return None;
        };
        let profile = tempfile::tempdir().unwrap();
        // It draws in software, and gives itself the priority that it wants: only in this class
        // does a rig without real-time scheduling go first.
        let mut child = Command::new("chrt")
            .args(["--idle", "0"])
            .arg(executable)
            .args(["--headless=new", "--no-sandbox", "--disable-gpu", "--remote-debugging-port=0"])
            .args(["--disable-dev-shm-usage", "--disable-extensions", "--no-first-run"])
            .args(["--disable-background-networking", "--mute-audio", "--hide-scrollbars"])
            .args(["--disable-component-update", "--window-size=1680,1050", "--lang=en"])
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .arg("about:blank")
            .env("HOME", profile.path())
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .process_group(0)
            .spawn()
            .unwrap();
        let mut said = String::new();
        let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
        let address = lines.by_ref().map_while(Result::ok).find_map(|line| {
            let address = line.strip_prefix("DevTools listening on ").map(str::to_owned);
            said += &line;
            said.push('\n');
            address
        });
        // What it says later must not fill the pipe.
        std::thread::spawn(move || lines.for_each(drop));
        let chromium = |address| Self { child, address, _profile: profile };
        match address {
            Some(address) => Some(chromium(address)),
            None => {
                drop(chromium(String::new()));
                panic!("Chromium did not start: {said}");
            }
        }
    }

    /// Connects to the browser, in a runtime.
    pub async fn connect(&self) -> Browser {
        let host = self.address.strip_prefix("ws://").and_then(|rest| rest.split('/').next());
        let host = host.unwrap_or_else(|| panic!("no address: {}", self.address)).to_owned();
        Browser { host, devtools: Devtools::connect(&self.address).await }
    }
}

impl Drop for Chromium {
    fn drop(&mut self) {
        // Its process group: helpers of the browser included.
        let group = rustix::process::Pid::from_raw(self.child.id() as i32);
        let _ended = group.map(|group| rustix::process::kill_process_group(group, Signal::KILL));
        let _status = self.child.wait();
    }
}

/// A connection to a browser.
pub struct Browser {
    /// Host and port.
    host: String,
    devtools: Devtools,
}

/// An open page.
pub struct Tab(Devtools);

impl Tab {
    /// Opens a page in a window of its own: one that lies behind another is not drawn.
    pub async fn open(browser: &Browser, address: &str) -> Self {
        let window = json!({"url": address, "newWindow": true});
        let opened = browser.devtools.call("Target.createTarget", window).await.unwrap();
        let target = opened["targetId"].as_str().unwrap();
        let page = format!("ws://{}/devtools/page/{target}", browser.host);
        let tab = Self(Devtools::connect(&page).await);
        let loaded = "document.readyState === 'complete' && location.href !== 'about:blank'";
        tab.wait(LOADED, loaded).await;
        tab
    }

    /// The value of an expression.
    pub async fn value<T: DeserializeOwned>(&self, expression: &str) -> T {
        let value = self.0.evaluate(expression).await;
        let value = value.unwrap_or_else(|error| panic!("{expression}: {error}"));
        serde_json::from_value(value).unwrap_or_else(|error| panic!("{expression}: {error}"))
    }

    /// The text of an element.
    pub async fn text(&self, selector: &str) -> String {
        self.value(&format!("document.querySelector({selector:?}).textContent")).await
    }

    /// Waits until an expression holds; `false` if it never did.
    pub async fn becomes(&self, limit: Duration, expression: &str) -> bool {
        let begun = Instant::now();
        while begun.elapsed() < limit {
            // A page that is being loaded has nothing to evaluate in.
            let holds = self.0.evaluate(&format!("Boolean({expression})")).await;
            if holds == Ok(Value::Bool(true)) {
                return true;
            }
            tokio::time::sleep(POLL).await;
        }
        false
    }

    /// Waits until an expression holds.
    pub async fn wait(&self, limit: Duration, expression: &str) {
        let body = "document.body.innerText";
        if !self.becomes(limit, expression).await {
            panic!("never: {expression}; the page: {}", self.value::<String>(body).await);
        }
    }

    /// Clicks on an element once it is active.
    pub async fn click(&self, selector: &str) {
        let active = format!("!document.querySelector({selector:?}).disabled");
        self.wait(Duration::from_secs(10), &active).await;
        let middle = format!(
            "(() => {{ const element = document.querySelector({selector:?}); \
             element.scrollIntoView({{ block: 'center', behavior: 'instant' }}); \
             const at = element.getBoundingClientRect(); \
             return [at.x + at.width / 2, at.y + at.height / 2]; }})()"
        );
        let (x, y): (f64, f64) = self.value(&middle).await;
        for kind in ["mouseMoved", "mousePressed", "mouseReleased"] {
            let button = if kind == "mouseMoved" { "none" } else { "left" };
            let event = json!({"type": kind, "x": x, "y": y, "button": button, "clickCount": 1});
            self.0.call("Input.dispatchMouseEvent", event).await.unwrap();
        }
    }

    /// Puts the cursor into a field.
    pub async fn focus(&self, selector: &str) {
        self.value::<bool>(&format!("(document.querySelector({selector:?}).focus(), true)")).await;
    }

    /// Presses a key and lets it go: `Escape`, `Delete` or a digit.
    pub async fn press(&self, key: &str) {
        let (code, number, text) = match key {
            "Escape" => (key.to_owned(), 27, ""),
            "Delete" => (key.to_owned(), 46, ""),
            // The codes of the digits are those of ASCII.
            digit => (format!("Digit{digit}"), u32::from(digit.as_bytes()[0]), digit),
        };
        for kind in ["keyDown", "keyUp"] {
            let mut event =
                json!({"type": kind, "key": key, "code": code, "windowsVirtualKeyCode": number});
            if kind == "keyDown" && !text.is_empty() {
                event["text"] = json!(text);
            }
            self.0.call("Input.dispatchKeyEvent", event).await.unwrap();
        }
    }

    /// Types into a field in place of what it holds.
    pub async fn fill(&self, selector: &str, text: &str) {
        self.focus(selector).await;
        self.value::<bool>(&format!("(document.querySelector({selector:?}).select(), true)")).await;
        match text {
            "" => self.press("Delete").await,
            text => drop(self.0.call("Input.insertText", json!({"text": text})).await.unwrap()),
        }
    }

    /// Keeps a picture of the page where `FARREACH_SCREENSHOTS` names a folder.
    pub async fn picture(&self, name: &str) {
        let Some(folder) = std::env::var_os("FARREACH_SCREENSHOTS") else { return };
        let path = Path::new(&folder).join(format!("{name}.png"));
        let drawn = self.0.call("Page.captureScreenshot", json!({"format": "png"})).await.unwrap();
        std::fs::write(path, BASE64.decode(drawn["data"].as_str().unwrap().as_bytes()).unwrap())
            .unwrap();
    }
}

//! A real browser: Chromium without a window, driven through its debugging port.
#![allow(dead_code, unreachable_pub)]

use std::io::{BufRead as _, BufReader};
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use chromiumoxide::cdp::browser_protocol::input::InsertTextParams;
use chromiumoxide::cdp::browser_protocol::page::CaptureScreenshotFormat;
use chromiumoxide::cdp::browser_protocol::target::CreateTargetParams;
use chromiumoxide::page::ScreenshotParams;
use chromiumoxide::{Browser, Page};
use futures_util::StreamExt as _;
use serde::de::DeserializeOwned;

use crate::common::Signal;

/// Pages are looked at so often.
const POLL: Duration = Duration::from_millis(100);

/// A browser of its own for one test; ended with all its processes in any case.
pub struct Chromium {
    child: Child,
    port: String,
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
        let port = lines.by_ref().map_while(Result::ok).find_map(|line| {
            let port = line.strip_prefix("DevTools listening on ").map(str::to_owned);
            said += &line;
            said.push('\n');
            port
        });
        // What it says later must not fill the pipe.
        std::thread::spawn(move || lines.for_each(drop));
        let chromium = |port| Self { child, port, _profile: profile };
        match port {
            Some(port) => Some(chromium(port)),
            None => {
                drop(chromium(String::new()));
                panic!("Chromium did not start: {said}");
            }
        }
    }

    /// Connects to the browser, in a runtime.
    pub async fn connect(&self) -> Browser {
        let (browser, mut handler) = Browser::connect(&self.port).await.unwrap();
        tokio::spawn(async move { while handler.next().await.is_some() {} });
        browser
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

/// An open page.
pub struct Tab(pub Page);

impl Tab {
    /// Opens a page in a window of its own: one that lies behind another is not drawn.
    pub async fn open(browser: &Browser, address: &str) -> Self {
        let window = CreateTargetParams::builder().url(address).new_window(true).build().unwrap();
        Self(browser.new_page(window).await.unwrap())
    }

    /// The value of an expression.
    pub async fn value<T: DeserializeOwned>(&self, expression: &str) -> T {
        let result = self.0.evaluate(expression.to_owned()).await;
        result.unwrap_or_else(|error| panic!("{expression}: {error}")).into_value().unwrap()
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
            let holds = self.0.evaluate(format!("Boolean({expression})")).await;
            if holds.is_ok_and(|holds| holds.into_value().unwrap_or(false)) {
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
        self.0.find_element(selector).await.unwrap().click().await.unwrap();
    }

    /// Types into a field in place of what it holds.
    pub async fn fill(&self, selector: &str, text: &str) {
        let field = self.0.find_element(selector).await.unwrap();
        self.value::<bool>(&format!("(document.querySelector({selector:?}).select(), true)")).await;
        field.focus().await.unwrap();
        match text {
            "" => drop(field.press_key("Delete").await.unwrap()),
            text => drop(self.0.execute(InsertTextParams::new(text)).await.unwrap()),
        }
    }

    /// Keeps a picture of the page where `FARREACH_SCREENSHOTS` names a folder.
    pub async fn picture(&self, name: &str) {
        let Some(folder) = std::env::var_os("FARREACH_SCREENSHOTS") else { return };
        let path = Path::new(&folder).join(format!("{name}.png"));
        let parameters = ScreenshotParams::builder().format(CaptureScreenshotFormat::Png).build();
        self.0.save_screenshot(parameters, path).await.unwrap();
    }
}

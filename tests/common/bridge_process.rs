//! A bridge as a process of its own, with what it says.
#![allow(dead_code, clippy::unwrap_used, clippy::expect_used, unreachable_pub)]

use std::io::{BufRead, BufReader};
use std::process::{Child, ChildStdout, Stdio};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use crate::common::{TestRig, wait_for};

const LIMIT: Duration = Duration::from_secs(60);

/// A running bridge; ends with the value.
pub struct Bridge {
    child: Child,
    /// Open, so that it can print more.
    _stdout: BufReader<ChildStdout>,
    /// What it printed first: the address without `ws://`.
    pub address: String,
    said: Arc<Mutex<Vec<String>>>,
}

impl Bridge {
    pub fn start(rig: &TestRig, words: &[&str]) -> Self {
        Self::start_with(rig, words, &[])
    }

    /// The same with further variables.
    pub fn start_with(rig: &TestRig, words: &[&str], variables: &[(&str, &str)]) -> Self {
        let mut command = rig.farreach(["bridge"]);
        command.args(words).envs(variables.iter().copied());
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let said: Arc<Mutex<Vec<String>>> = Arc::default();
        let (stderr, into) = (child.stderr.take().unwrap(), Arc::clone(&said));
        std::thread::spawn(move || {
            for line in BufReader::new(stderr).lines().map_while(Result::ok) {
                eprintln!("bridge: {line}");
                into.lock().unwrap().push(line);
            }
        });
        let mut first = String::new();
        let mut stdout = BufReader::new(child.stdout.take().unwrap());
        stdout.read_line(&mut first).unwrap();
        let address = first.trim().trim_start_matches("ws://").to_owned();
        assert!(!address.is_empty(), "the bridge ended: {:?}", said.lock().unwrap());
        Self { child, _stdout: stdout, address, said }
    }

    pub fn pid(&self) -> i32 {
        self.child.id() as i32
    }

    /// A line on its standard error that contains both.
    pub fn find(&self, one: &str, other: &str) -> Option<String> {
        let said = self.said.lock().unwrap();
        said.iter().find(|line| line.contains(one) && line.contains(other)).cloned()
    }

    /// Waits for such a line.
    pub fn line(&self, one: &str, other: &str) -> String {
        assert!(wait_for(LIMIT, || self.find(one, other).is_some()), "{one} ... {other}");
        self.find(one, other).unwrap()
    }

    /// Waits for its end.
    pub fn exit_code(&mut self) -> Option<i32> {
        self.child.wait().unwrap().code()
    }
}

impl Drop for Bridge {
    fn drop(&mut self) {
        let _ended = self.child.kill();
        let _status = self.child.wait();
    }
}

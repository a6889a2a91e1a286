//! The console in a real browser: an operator sets a matching experiment up, homes the rig, runs it
//! with the emulated scanner and the simulated subject, and stops it; and another one goes on
//! although console, experiment process and logger are killed in a session.
#![allow(clippy::unwrap_used, clippy::expect_used)]

#[path = "common/browser.rs"]
mod browser;
mod common;
#[path = "common/devtools.rs"]
mod devtools;

use std::collections::BTreeSet;
use std::path::Path;
use std::time::{Duration, Instant};

use ipc_types::{Event, EventKind, SCANNER_KEY, ScannerPulse};
use recording::mcap_read::Recording;
use serde_json::Value;

use browser::{Browser, Chromium, Tab};
use common::playing::messages;
use common::{Signal, TestRig, kill, wait_for};

/// How often an experiment is begun again: on a loaded host the rig may trip, rightly.
const ATTEMPTS: usize = 10;
const SHORT: Duration = Duration::from_secs(15);
const LONG: Duration = Duration::from_secs(60);
/// Whether the rig has tripped.
const TRIPPED: &str = "['tripped', 'faulted'].includes(
    document.querySelector('#watchdog').dataset.state)";

/// Addresses of the pages.
fn pages(rig: &TestRig) -> (String, String) {
    let pages: Value = serde_json::from_str(&rig.ok(["console", "--json"])).unwrap();
    let address = |page: &str| pages[page].as_str().unwrap().to_owned();
    (address("operator"), address("subject"))
}

fn block_on<T>(work: impl Future<Output = T>) -> T {
    tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap().block_on(work)
}

/// An expression: the watchdog's state.
fn state_is(state: &str) -> String {
    format!("document.querySelector('#watchdog').dataset.state === '{state}'")
}

/// An expression: the note contains a text.
fn note_has(text: &str) -> String {
    format!("document.querySelector('#note').textContent.includes('{text}')")
}

/// An expression: the model beside the machine is told with a text.
fn model_has(text: &str) -> String {
    format!("document.querySelector('#model p')?.textContent.includes('{text}')")
}

/// An expression: the list of files contains a name.
fn written_has(name: &str) -> String {
    format!("document.querySelector('#written').textContent.includes('{name}')")
}

/// Sets values of the protocol, as a person types them.
async fn set(operator: &Tab, values: &[(&str, &str)]) {
    for (key, value) in values {
        operator.fill(&format!(".entry[data-path='{key}'] input"), value).await;
    }
}

/// Opens the operator's page, which gets control, and chooses a protocol with short sessions.
async fn open(browser: &Browser, address: &str, protocol: &str) -> Tab {
    let operator = Tab::open(browser, address).await;
    operator
        .wait(SHORT, "document.querySelector('#access').textContent.includes('control.')")
        .await;
    choose(&operator, protocol).await;
    operator
}

/// Chooses a protocol and waits for its values.
async fn choose(operator: &Tab, protocol: &str) {
    let chosen = format!(
        "(protocol.value = '{protocol}', protocol.dispatchEvent(new Event('change')), true)"
    );
    operator.value::<bool>(&chosen).await;
    operator.wait(SHORT, "document.querySelector('[data-path=\"matching.rest_s\"] input')").await;
    let shortest = [
        ("matching.sets", "1"),
        ("matching.session_s", "5"),
        ("matching.rest_s", "10"),
        ("scanner.repetition_s", "1"),
    ];
    set(operator, &shortest).await;
    let emulated = "(pulses.value = 'emulated', pulses.onchange(), true)";
    operator.value::<bool>(emulated).await;
    operator.fill("#emulate", "1").await;
}

/// Brings the rig from whatever state to `armed`, by the page's buttons.
async fn arm(operator: &Tab) {
    for _ in 0..20 {
        let state: String =
            operator.value("document.querySelector('#watchdog').dataset.state").await;
        let next = match state.as_str() {
            "armed" => return,
            "enabled" => "disarm",
            "disarmed" => "arm",
            _ => "reset",
        };
        operator.click(&format!("[data-verb='{next}']")).await;
        let changed = format!("!({})", state_is(&state));
        operator.becomes(Duration::from_secs(2), &changed).await;
    }
    panic!("never armed: {}", operator.text("#interlocks").await);
}

/// Finds the stops by the page's button, again after a trip.
async fn home(operator: &Tab) {
    for _ in 0..ATTEMPTS {
        arm(operator).await;
        operator.click("#initialise").await;
        let over = format!("{TRIPPED} || {}", note_has("the stops were found"));
        operator.wait(LONG, &over).await;
        if operator.value::<bool>(&note_has("the stops were found")).await {
            operator
                .wait(SHORT, "!document.querySelector('#handle').textContent.includes('NOT')")
                .await;
            return;
        }
    }
    panic!("never homed");
}

/// Builds and starts the protocol with these session files; waits until it plays.
async fn start(operator: &Tab, files: &str) {
    operator.fill("#files", files).await;
    operator.click("#build").await;
    operator
        .wait(SHORT, "document.querySelector('#answer').textContent.includes('is ready')")
        .await;
    operator.wait(SHORT, "!document.querySelector('#start').disabled").await;
    operator.click("#start").await;
    operator.wait(SHORT, "document.querySelector('#timeline .now')").await;
}

/// Waits for a segment, by its label; `false` if the rig trips first.
async fn reaches(operator: &Tab, label: &str) -> bool {
    operator.wait(LONG, &format!("{TRIPPED} || {}", note_has(label))).await;
    !operator.value::<bool>(TRIPPED).await
}

fn is_matlab(path: &Path) -> bool {
    std::fs::read(path).is_ok_and(|bytes| bytes.starts_with(b"MATLAB 5.0 MAT-file"))
}

/// The sessions of a recording with all its parts: number and outcome.
fn outcomes(rig: &TestRig, parts: &[&str]) -> Vec<(u64, String)> {
    let path = |name: &str| rig.path(name).to_str().unwrap().to_owned();
    let all = path("all.mcap");
    let parts: Vec<String> =
        parts.iter().map(|name| path(name)).filter(|part| Path::new(part).exists()).collect();
    let mut merge = vec!["rec".to_owned(), "merge".to_owned()];
    merge.extend(parts);
    merge.extend(["-o".to_owned(), all.clone()]);
    let _merged = rig.run(merge);
    let listed = rig.run(["rec", "sessions", &all, "--json"]);
    let sessions: Value = serde_json::from_slice(&listed.stdout).unwrap();
    let of = |session: &Value| {
        let outcome = session["outcome"].as_str().unwrap().to_owned();
        (session["number"].as_u64().unwrap(), outcome)
    };
    sessions.as_array().unwrap().iter().map(of).collect()
}

/// One attempt: a force-matching experiment up to its second session, in which it is stopped by the
/// keyboard. `false` where the rig tripped.
async fn match_force_and_stop(operator: &Tab, subject: &Tab, files: &str) -> bool {
    arm(operator).await;
    start(operator, files).await;
    operator.picture("operator-waiting").await;
    if !reaches(operator, "session 1 of 2").await {
        return false;
    }
    subject.wait(SHORT, "document.querySelector('#view').dataset.light === 'green'").await;
    subject.picture("subject-first").await;
    if !reaches(operator, "rest 1").await {
        return false;
    }
    subject.wait(SHORT, "document.querySelector('#view').dataset.light === 'red'").await;
    subject.picture("subject-rest").await;
    if !reaches(operator, "session 2 of 2").await {
        return false;
    }
    // The bar moves: it is set anew each second.
    let (mut heights, mut mirrored) = (BTreeSet::new(), false);
    let begun = Instant::now();
    while (heights.len() < 2 || !mirrored) && begun.elapsed() < Duration::from_secs(4) {
        let bar = |page| format!("document.querySelector('{page} .tracks')?.dataset.heights || ''");
        heights.insert(subject.value::<String>(&bar("#view")).await);
        heights.remove("");
        mirrored |= !operator.value::<String>(&bar("#mirror")).await.is_empty();
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    if operator.value::<bool>(TRIPPED).await {
        return false;
    }
    subject.picture("subject-bar").await;
    operator.picture("operator-session").await;
    assert!(mirrored, "no bar on the operator's page");
    operator.press("Escape").await;
    operator.wait(LONG, &format!("{TRIPPED} || {}", note_has("was stopped"))).await;
    if operator.value::<bool>(TRIPPED).await {
        return false;
    }
    assert!(heights.len() >= 2, "the bar stands still: {heights:?}");
    true
}

#[test]
fn an_operator_runs_a_force_matching_experiment_in_a_browser() {
    let Some(chromium) = Chromium::start() else { return };
    let rig = TestRig::patient("console");
    let file = rig.path("run.mcap");
    let console = ["--console", "127.0.0.1:0", "--record", file.to_str().unwrap()];
    rig.ok(["up", "--simulate", "--monitor"].into_iter().chain(console));
    let (operator_page, subject_page) = pages(&rig);
    block_on(async {
        let browser = chromium.connect().await;
        let operator = open(&browser, &operator_page, "force-matching").await;
        // Before anything has moved; in the words of the status, and without a warning.
        operator.wait(SHORT, &model_has("axis 0: learning, 0 % while it moves")).await;
        assert!(operator.value::<bool>("document.querySelector('#departed').hidden").await);
        operator.fill("#subject", "Jörg").await;

        // A value beyond its limit is refused, and named.
        set(&operator, &[("matching.frequency_hz", "9")]).await;
        operator.click("#build").await;
        let wrong = "[data-path='matching.frequency_hz'].wrong small";
        operator.wait(SHORT, &format!("document.querySelector(\"{wrong}\")")).await;
        assert!(
            operator.text(wrong).await.contains("from 0.2 to 3"),
            "{}",
            operator.text(wrong).await
        );
        assert!(operator.value::<bool>("document.querySelector('#start').disabled").await);
        operator.picture("operator-refused").await;
        set(&operator, &[("matching.frequency_hz", "1")]).await;

        home(&operator).await;
        let plotted = "document.querySelector('#model path.master').getAttribute('d')";
        operator.wait(SHORT, plotted).await;
        let subject = Tab::open(&browser, &subject_page).await;
        subject.click("#sound").await;
        let mut files = String::new();
        for attempt in 1..=ATTEMPTS {
            files = format!("S{attempt}_");
            if match_force_and_stop(&operator, &subject, &files).await {
                break;
            }
        }
        // The file of the whole session, and that of the one that was stopped.
        let both = [format!("{files}1.mat"), format!("{files}2_stopped.mat")];
        operator.wait(LONG, &written_has(&both[1])).await;
        operator.picture("operator-stopped").await;
        for file in both {
            let path = rig.path(&file);
            assert!(is_matlab(&path), "{path:?}: {}", operator.text("#written").await);
        }
        operator.wait(SHORT, "document.querySelectorAll('#sessions tbody tr').length >= 2").await;
        operator.fill("#text", "Lampe über dem Gerät aus").await;
        operator.click("[data-do='note']").await;
        operator.wait(SHORT, "document.querySelector('#answer').textContent === 'noted'").await;
        build_what_was_stopped(&operator).await;
        press_the_scanners_key(&operator).await;
        check_access(&browser, &operator, &operator_page).await;
    });
    rig.ok(["rec", "stop"]);
    let outcomes = outcomes(&rig, &["run.mcap"]);
    let last: Vec<_> = outcomes.iter().rev().take(2).rev().cloned().collect();
    assert_eq!(last, [(1, "whole".to_owned()), (2, "stopped".to_owned())], "{outcomes:?}");
    let recording = Recording::open(&file).unwrap();
    let events: Vec<Event> = messages(&recording, "event/console");
    let has = |kind: EventKind, text: &str| {
        events.iter().any(|event| event.kind == kind.code() && event.text().contains(text))
    };
    assert!(has(EventKind::Note, "Lampe über dem Gerät aus"), "no note is recorded");
    assert!(has(EventKind::FrameDelay, "subject page"), "the delay of the frames is not recorded");
    assert!(has(EventKind::ClockMeasured, "operator"), "no page's clock is recorded");
    assert!(has(EventKind::ControlTaken, "from page"), "that control was taken is not recorded");
    assert!(has(EventKind::SoundPlayed, "session started"), "no sound is recorded");
    assert!(has(EventKind::InstructionShown, "No force"), "no instruction is recorded");
    let typed: Vec<ScannerPulse> = messages(&recording, SCANNER_KEY.topic.name);
    assert!(!typed.is_empty(), "no key is recorded");
    rig.down();
}

/// Reads the experiment that was stopped in its second session, ready to be continued.
async fn build_what_was_stopped(operator: &Tab) {
    operator.fill("#files", "C_").await;
    operator.click("#interrupted").await;
    let ready = "document.querySelector('#answer').textContent.includes('goes on after session 1')";
    operator.wait(SHORT, ready).await;
    operator.wait(SHORT, "document.querySelectorAll('#timeline div').length >= 5").await;
}

/// Plays a protocol that takes its pulses from the key 5, and presses it in a field for text.
async fn press_the_scanners_key(operator: &Tab) {
    let chosen = "(protocol.value = 'block-design', protocol.onchange(), \
                  pulses.value = 'key', pulses.onchange(), true)";
    for _ in 0..ATTEMPTS {
        arm(operator).await;
        operator.value::<bool>(chosen).await;
        let described = "document.querySelector('[data-path=\"scanner.repetition_s\"] input')";
        operator.wait(SHORT, described).await;
        start(operator, "").await;
        operator.focus("#text").await;
        operator.press("5").await;
        let counted = "/^1 .*volumes, key 5/.test(document.querySelector('#scanner').textContent)";
        operator.wait(LONG, &format!("{TRIPPED} || {counted}")).await;
        let typed: String = operator.value("document.querySelector('#text').value").await;
        assert_eq!(typed, "", "a field got the character");
        let tripped = operator.value::<bool>(TRIPPED).await;
        operator.click("#stop").await;
        if !tripped {
            operator.wait(LONG, &note_has("was stopped")).await;
            return;
        }
    }
    panic!("no key was counted");
}

/// A page without the token watches; a second one with it may stop, and take control.
async fn check_access(browser: &Browser, operator: &Tab, address: &str) {
    let watching = Tab::open(browser, address.split('#').next().unwrap()).await;
    let forget = "(sessionStorage.clear(), location.reload(), true)";
    watching.value::<bool>(forget).await;
    watching.wait(SHORT, "document.querySelector('#watchdog').dataset.state").await;
    let asked = "Link.send({ do: 'verb', verb: 'estop' }).then((answer) => answer.text)";
    assert!(watching.value::<String>(asked).await.contains("no token"));

    let second = Tab::open(browser, address).await;
    second.wait(SHORT, "document.querySelector('#access').textContent.includes('Another')").await;
    let asked = "Link.send({ do: 'verb', verb: 'arm' }).then((answer) => answer.text)";
    assert!(second.value::<String>(asked).await.contains("another page has control"));
    second.click("[data-do='take-control']").await;
    second
        .wait(SHORT, "document.querySelector('#access').textContent.includes('has control.')")
        .await;
    operator.wait(SHORT, "document.querySelector('#build').disabled").await;
    // Whoever has the token may stop the rig.
    operator.click("#estop").await;
    second.wait(SHORT, &state_is("tripped")).await;
}

/// Kills processes of the rig.
fn kill_all(rig: &TestRig, units: &[&str]) {
    let status = rig.launcher_status();
    for unit in units {
        let process = status.unit(unit).and_then(|unit| unit.process).expect(unit);
        kill(process.pid, Signal::KILL);
    }
}

/// One attempt: an EMG-matching experiment to its end, with kills in its second session. `false`
/// where the rig tripped.
async fn match_emg_with_kills(rig: &TestRig, operator: &Tab, subject: &Tab, files: &str) -> bool {
    arm(operator).await;
    start(operator, files).await;
    if !reaches(operator, "session 2 of 2").await {
        return false;
    }
    tokio::time::sleep(Duration::from_millis(1500)).await;
    let two = "document.querySelectorAll('#view .track').length === 2";
    // Not where the rig has tripped meanwhile.
    subject.becomes(Duration::from_secs(3), two).await;
    subject.picture("subject-emg").await;
    operator.picture("operator-emg").await;
    let before = rig.launcher_status();
    kill_all(rig, &["console", "experiment", "logger"]);
    let back = |unit: &str| {
        let now = rig.launcher_status();
        let restarts = |status: &launch::Status| status.unit(unit).map_or(0, |unit| unit.restarts);
        restarts(&now) > restarts(&before)
    };
    let all = || ["console", "experiment", "logger"].iter().all(|unit| back(unit));
    assert!(wait_for(LONG, all), "{:?}", rig.launcher_status());
    operator.wait(SHORT, "document.querySelector('#alarm').hidden").await;
    let over = format!("{TRIPPED} || {}", note_has("ran to its end"));
    operator.wait(LONG, &over).await;
    operator.value::<bool>(&note_has("ran to its end")).await
}

#[test]
fn a_session_goes_on_although_console_and_experiment_and_logger_are_killed() {
    let Some(chromium) = Chromium::start() else { return };
    let rig = TestRig::patient("console-kill");
    let file = rig.path("run.mcap");
    let rig_file = rig.absolute_rig("hydrostatic");
    let console = ["--console", "127.0.0.1:0", "--record", file.to_str().unwrap()];
    rig.ok(["up", "--simulate", "--rig", &rig_file].into_iter().chain(console));
    let (operator_page, subject_page) = pages(&rig);
    let mut files = String::new();
    block_on(async {
        let browser = chromium.connect().await;
        let operator = open(&browser, &operator_page, "emg-matching").await;
        let subject = Tab::open(&browser, &subject_page).await;
        let mut done = false;
        for attempt in 1..=ATTEMPTS {
            files = format!("E{attempt}_");
            done = match_emg_with_kills(&rig, &operator, &subject, &files).await;
            if done {
                break;
            }
        }
        assert!(done, "the rig tripped {ATTEMPTS} times");
        operator.wait(LONG, &written_has(&format!("{files}2.mat"))).await;
        operator.picture("operator-resumed").await;
    });
    for number in 1..=2 {
        let path = rig.path(&format!("{files}{number}.mat"));
        assert!(is_matlab(&path), "{path:?}");
        assert!(std::fs::metadata(&path).unwrap().len() > 800_000, "{path:?} is not whole");
    }
    // What the killed logger had not written is lost, and told.
    assert_eq!(rig.run(["rec", "stop"]).status.code(), Some(3));
    let parts: Vec<String> = (1..=ATTEMPTS + 1)
        .map(|part| if part == 1 { "run.mcap".to_owned() } else { format!("run.part{part}.mcap") })
        .collect();
    let parts: Vec<&str> = parts.iter().map(String::as_str).collect();
    let outcomes = outcomes(&rig, &parts);
    let whole: Vec<u64> = outcomes
        .iter()
        .rev()
        .filter(|(_, outcome)| outcome == "whole")
        .map(|(number, _)| *number)
        .take(2)
        .collect();
    assert_eq!(whole, [2, 1], "{outcomes:?}");
    rig.down();
}

//! What `rec verify` finds and says.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::fs;

use ipc_types::{LossCounters, SAMPLE};
use recorder::{DATA_LOST, DONE};
use recording::mcap_write::{Start, Writer};

use common::short::{sample, write};
use common::{Folder, fails, rec};

#[test]
fn info_and_verify_of_a_sound_recording() {
    let dir = Folder::new();
    write(&dir.path("run.mcap"), 0..2000, true);
    let (code, text) = rec(&["info", &dir.text("run.mcap")]);
    assert_eq!(code, DONE);
    for expected in
        ["rig hydrostatic, profile best-effort, part 1", "ended cleanly", "2000.0", "500.0"]
    {
        assert!(text.contains(expected), "{expected}: {text}");
    }
    let (code, text) = rec(&["verify", &dir.text("run.mcap")]);
    assert_eq!(code, DONE, "{text}");
    let sound = format!(
        "{}: nothing lost: 2,500 messages, 2 topics with data, every checksum right\n  sample: \
         ticks 1000 to 2999, none missing, none filled in late\n",
        dir.text("run.mcap")
    );
    assert_eq!(text, sound);
    let (_, text) = rec(&["info", &dir.text("run.mcap"), "--json"]);
    let value: serde_json::Value = serde_json::from_str(&text).unwrap();
    // By the summary alone: what was not read is not claimed.
    let null = serde_json::Value::Null;
    assert_eq!((&value["verified"], &value["data_lost"]), (&false.into(), &null));
    assert_eq!((&value["ticks"], &value["topics"][0]["gaps"]), (&null, &null));
    assert_eq!(value["metadata"][0]["values"]["rig"], "hydrostatic");
    let (_, text) = rec(&["verify", &dir.text("run.mcap"), "--json"]);
    let read: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!((&read["verified"], &read["data_lost"]), (&true.into(), &false.into()));
    let keys = |value: &serde_json::Value| -> Vec<String> {
        let mut keys: Vec<String> = value.as_object().unwrap().keys().cloned().collect();
        keys.sort();
        keys
    };
    assert_eq!(keys(&value["topics"][0]), keys(&read["topics"][0]));
    for key in ["topic", "type", "count", "first_ns", "last_ns", "rate_hz", "dropped"] {
        for (own, other) in
            value["topics"].as_array().unwrap().iter().zip(read["topics"].as_array().unwrap())
        {
            assert_eq!(own[key], other[key], "{key}");
        }
    }
    assert_eq!(value["began_ns"], read["began_ns"]);
}

#[test]
fn verify_reports_a_killed_logger_and_recover_makes_a_new_file() {
    let dir = Folder::new();
    write(&dir.path("killed.mcap"), 0..2000, false);
    let (code, text) = rec(&["verify", &dir.text("killed.mcap")]);
    assert_eq!(code, DATA_LOST);
    assert!(text.contains("DATA LOST") && text.contains("without a footer"), "{text}");
    assert!(text.contains("could end it (0 bytes unreadable)\n"), "{text}");
    let (code, text) = rec(&["recover", &dir.text("killed.mcap"), "-o", &dir.text("mended.mcap")]);
    assert_eq!(code, DATA_LOST);
    assert!(text.contains("messages"), "{text}");
    let (code, text) = rec(&["verify", &dir.text("mended.mcap")]);
    assert_eq!(code, DATA_LOST, "recovered, but its end is still missing");
    assert!(text.contains("did not end cleanly"), "{text}");
    assert!(
        fails(&["recover", &dir.text("killed.mcap"), "-o", &dir.text("mended.mcap")])
            .contains("never overwritten")
    );
}

#[test]
fn verify_counts_what_is_missing() {
    let dir = Folder::new();
    write(&dir.path("holes.mcap"), (0..500).chain(510..1000), true);
    let (code, text) = rec(&["verify", &dir.text("holes.mcap")]);
    assert_eq!(code, DATA_LOST);
    assert!(text.contains("sample: 990 messages; 10 missing in 1 place"), "{text}");
    assert!(
        text.contains("command: 247 messages; 3 missing in 1 place") || text.contains("2 missing"),
        "{text}"
    );
    let (code, json) = rec(&["verify", &dir.text("holes.mcap"), "--json"]);
    let value: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!((code, &value["ticks"]["missing"]), (DATA_LOST, &serde_json::json!(10)));
}

#[test]
fn verify_tells_each_kind_of_loss_and_its_topic() {
    let dir = Folder::new();
    let path = dir.path("holes.mcap");
    let mut writer = Writer::create(&path, &Start::default(), 0).unwrap();
    for i in (0..500).chain([499]).chain(510..1000).chain(2190..2200) {
        writer.write_message(&SAMPLE, &sample(i)).unwrap();
    }
    writer.finish(&[LossCounters { dropped: 3, ..LossCounters::default() }]).unwrap();
    let (code, text) = rec(&["verify", &dir.text("holes.mcap")]);
    let expected = format!(
        "{}: DATA LOST\n  sample: 1,001 messages; 1,200 missing in 2 places; 3 dropped or refused \
         by the logger; 1 repeated or out of order\n  sample: ticks 1000 to 3199, 1,200 missing in \
         2 places, 1 not ascending, none filled in late\n",
        dir.text("holes.mcap")
    );
    assert_eq!((code, text), (DATA_LOST, expected));
}

/// What the end of a recording says of losses need not be looked for.
#[test]
fn info_tells_that_data_are_lost_where_the_summary_does() {
    let dir = Folder::new();
    let lost = |name: &str| {
        let (code, text) = rec(&["info", &dir.text(name), "--json"]);
        let value: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert_eq!((code, &value["verified"]), (DONE, &false.into()), "{name}");
        value["data_lost"].clone()
    };
    let mut writer = Writer::create(&dir.path("dropped.mcap"), &Start::default(), 0).unwrap();
    writer.write_message(&SAMPLE, &sample(0)).unwrap();
    writer.finish(&[LossCounters { dropped: 3, ..LossCounters::default() }]).unwrap();
    assert_eq!(lost("dropped.mcap"), true);
    write(&dir.path("killed.mcap"), 0..2000, false);
    rec(&["recover", &dir.text("killed.mcap"), "-o", &dir.text("mended.mcap")]);
    assert_eq!(lost("mended.mcap"), true);
}

#[test]
fn verify_says_where_a_file_is_damaged_or_torn() {
    let dir = Folder::new();
    write(&dir.path("run.mcap"), 0..2000, true);
    let sound = fs::read(dir.path("run.mcap")).unwrap();
    let mut damaged = sound.clone();
    damaged[sound.len() / 2] ^= 1;
    fs::write(dir.path("run.mcap"), damaged).unwrap();
    let (code, text) = rec(&["verify", &dir.text("run.mcap")]);
    assert!(code == DATA_LOST && text.contains("\n  damaged at byte "), "{text}");
    fs::write(dir.path("run.mcap"), &sound[..sound.len() - 10]).unwrap();
    let (code, text) = rec(&["verify", &dir.text("run.mcap")]);
    assert!(code == DATA_LOST && text.contains(" bytes are there ("), "{text}");
    assert!(text.contains(" bytes unreadable)\n"), "{text}");
}

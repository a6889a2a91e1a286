//! Layout, schema and table of topics.

use std::collections::HashSet;

use ipc_types::*;
use proptest::prelude::*;

#[test]
fn schema_lists_every_field_with_type_and_unit() {
    let schema = Sample::schema();
    assert!(
        schema.contains(
            "# position of the master, from its zero (rad or m)\nfloat64[3] master_position\n"
        ),
        "{schema}"
    );
    assert!(schema.contains("uint64 tick\n"));
    assert!(schema.contains("int64[3] slave_counts\n"));
    let constants = GateState::ALL.len() + GateCause::ALL.len() + CardKind::ALL.len();
    let lines = schema.lines().filter(|line| !line.starts_with('#')).count();
    assert_eq!(lines, Sample::FIELDS.len() + constants + Profile::ALL.len());
}

#[test]
fn codes_stand_in_the_schema_and_have_a_meaning() {
    let schema = Event::schema();
    assert!(schema.contains("uint8 KIND_PROCESS_STARTED=0\nuint8 KIND_"), "{schema}");
    let kind = Event::FIELDS.iter().find(|field| field.name == "kind").unwrap();
    assert_eq!(kind.meaning(Value::Unsigned(6)), Some("protocol done"));
    assert_eq!(kind.meaning(Value::Unsigned(200)), None);
    assert_eq!(Event::FIELDS[0].meaning(Value::Unsigned(0)), None, "a session is a number");
}

#[test]
fn every_field_is_aligned_as_cdr_wants_it() {
    for topic in TOPICS {
        let mut end = 0;
        for field in topic.fields {
            assert_eq!(field.offset, end, "{} {}", topic.name, field.name);
            assert_eq!(field.offset % field.primitive.size(), 0, "{} {}", topic.name, field.name);
            end += field.count() * field.primitive.size();
        }
        assert_eq!(end, topic.size, "{}", topic.name);
    }
}

#[test]
fn every_topic_resolves_to_its_message() {
    struct Names;
    impl TypeVisitor for Names {
        type Output = (&'static str, usize);
        fn visit<T: Message>(self) -> Self::Output {
            (T::TYPE_NAME, size_of::<T>())
        }
    }
    for topic in TOPICS {
        let found = visit_type(topic.type_name, Names);
        assert_eq!(found, Some((topic.type_name, topic.size)), "{}", topic.name);
    }
    assert_eq!(visit_type("farreach.Sample.v0", Names), None);
}

/// Recordings hold indices into the table of topics: what a release had keeps its place.
#[test]
fn the_first_topics_keep_their_places() {
    let expected = "sample command token enable_line card_scan card_output setpoint loss clock \
        event/simulator event/acquisition event/control event/watchdog event/logger \
        event/experiment heartbeat/logger heartbeat/experiment timing/simulator \
        timing/acquisition timing/control timing/watchdog timing/experiment";
    let names = TOPICS.iter().map(|topic| topic.name);
    assert!(names.take(22).eq(expected.split_whitespace()));
}

#[test]
fn a_process_starts_after_the_keeper_runs_in_its_period_and_owns_what_bears_its_name() {
    for entry in PROCESSES {
        let process = entry.process;
        let keeper = process == Process::Keeper;
        assert_eq!(entry.after.contains(&Process::Keeper), !keeper, "{process}");
        assert!(!entry.after.contains(&process), "{process}");
        // The watchdog comes after everything that it watches, and waits for nothing else.
        let watched = PROCESSES.iter().filter(|entry| !entry.optional).map(|entry| entry.process);
        assert!(
            process != Process::Watchdog
                || watched.filter(|it| *it != process).all(|it| entry.after.contains(&it)),
            "{process}"
        );
        if let Some(own) = entry.real_time {
            assert!(own.phase_us < 1_000_000 / own.rate_hz, "{process}");
            assert!(timing_topic(process).is_some(), "{process}");
        }
        // The keeper has the shared memory only.
        assert_eq!(event_topic(process).is_some(), !keeper, "{process}");
        assert_eq!(pulse_topic(process).is_some(), !keeper, "{process}");
    }
    for topic in TOPICS {
        assert!(topic.owner.entry().is_some(), "{}", topic.name);
        if let Some((_, process)) = topic.name.split_once('/') {
            assert_eq!(process, topic.owner.text(), "{}", topic.name);
        }
    }
}

#[test]
fn topic_names_are_unique_and_types_carry_a_version() {
    let mut names = HashSet::new();
    for topic in TOPICS {
        assert!(names.insert(topic.name), "{} twice", topic.name);
        assert!(
            topic.type_name.rsplit_once(".v").is_some_and(|(_, v)| v.parse::<u32>().is_ok()),
            "{}",
            topic.type_name
        );
        assert!(topic.history <= topic.buffer, "{}", topic.name);
    }
    for topic in [COMMAND.topic, TOKEN.topic, ENABLE_LINE.topic, CARD_OUTPUT.topic] {
        assert_eq!(
            topic.history, 0,
            "{} must not hand an old message to a late joiner",
            topic.name
        );
    }
}

#[test]
fn codes_round_trip_and_unknown_codes_are_none() {
    for code in 0..=u8::MAX {
        assert!(TripCause::from_code(code).is_none_or(|cause| cause.code() == code));
        assert!(GateCause::from_code(code).is_none_or(|cause| cause.code() == code));
    }
    assert!(TripCause::ALL.len() <= 64, "faults are one bit each of a u64");
    assert_eq!(WatchdogState::from_code(200), None);
}

/// Programs read these names in `--json`, and these codes in recordings.
#[test]
fn codes_keep_their_numbers_and_their_names_in_json() {
    fn name(code: impl serde::Serialize) -> String {
        serde_json::to_value(code).unwrap().as_str().unwrap().to_owned()
    }
    let names: Vec<_> = GateState::ALL.iter().map(name).collect();
    assert_eq!(names, ["closed", "open", "burnt"]);
    assert_eq!(GateState::LatchedClosed.code(), 2);
    assert_eq!(TripCause::GateLatched.code(), 7);
    assert_eq!(name(TripCause::GateLatched), "gate_burnt");
    assert_eq!(serde_json::from_str::<GateState>("\"burnt\"").unwrap(), GateState::LatchedClosed);
    let names: Vec<_> = CardKind::ALL.iter().map(name).collect();
    assert_eq!(names, ["simulated", "replay", "null", "hardware", "comedi"]);
    assert!(CardKind::ALL.iter().all(|kind| name(kind) == kind.text()));
}

proptest! {
    #[test]
    fn bytes_round_trip(
        tick: u64,
        master_position in any::<[f64; 3]>(),
        slave_counts in any::<[i64; 3]>(),
        gate_state: u8,
    ) {
        let sample =
            Sample { tick, master_position, slave_counts, gate_state, ..Sample::default() };
        let bytes = sample.as_bytes();
        prop_assert_eq!(bytes.len(), size_of::<Sample>());
        let back = Sample::from_bytes(bytes).unwrap();
        prop_assert_eq!(back.as_bytes(), bytes);
        for field in Sample::FIELDS {
            let value = field.read(bytes, 0).unwrap();
            match field.name {
                "tick" => prop_assert_eq!(value, Value::Unsigned(tick)),
                "slave_counts" => prop_assert_eq!(value, Value::Signed(slave_counts[0])),
                "gate_state" => prop_assert_eq!(value, Value::Unsigned(u64::from(gate_state))),
                _ => {}
            }
        }
        prop_assert!(Sample::from_bytes(&bytes[1..]).is_none());
    }

    #[test]
    fn event_text_is_cut_at_a_character(text in "\\PC{0,200}") {
        let event = Event::new(Process::Control, EventKind::DataLost, Severity::Warning, &text);
        prop_assert!(text.starts_with(event.text()));
        prop_assert!(text.len() <= TEXT || event.text().len() > TEXT - 4);
    }
}

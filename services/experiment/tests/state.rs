//! The kept state: what was written comes back, and damage is seen.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use experiment::scan_tracker::ScanState;
use experiment::session_state::SessionState;
use experiment::state::{PlayerState, StateError};
use files::FormatError;
use proptest::prelude::*;

fn state(segment: u32, text: &str) -> PlayerState {
    PlayerState {
        session: 7,
        name: "demo".to_owned(),
        text: text.to_owned(),
        protocol: rig::identity(text),
        segment,
        running: true,
        epoch: 9,
        client: 11,
        scan: ScanState::default(),
        sessions: SessionState::default(),
    }
}

proptest! {
    #[test]
    fn comes_back(segment: u32, text in ".*") {
        let state = state(segment, &text);
        prop_assert_eq!(PlayerState::decode(&state.encode().unwrap()).unwrap(), state);
    }

    #[test]
    fn any_flipped_bit_is_an_error(at: prop::sample::Index, bit in 0..8u8) {
        let mut bytes = state(3, "[protocol]\nname = \"demo\"\n").encode().unwrap();
        let at = at.index(bytes.len());
        bytes[at] ^= 1 << bit;
        prop_assert!(PlayerState::decode(&bytes).is_err());
    }

    #[test]
    fn any_cut_is_an_error(at: prop::sample::Index) {
        let bytes = state(3, "[protocol]\nname = \"demo\"\n").encode().unwrap();
        prop_assert!(PlayerState::decode(&bytes[..at.index(bytes.len())]).is_err());
    }

    #[test]
    fn no_bytes_make_it_panic(bytes: Vec<u8>) {
        prop_assert!(PlayerState::decode(&bytes).is_err());
    }
}

#[test]
fn says_what_is_wrong() {
    let error = PlayerState::decode(b"hello").unwrap_err().to_string();
    assert_eq!(
        error,
        "no state of the experiment: expected 14 bytes that begin with \"FRPS\", found \"hell\"; \
         delete the file and start the protocol anew"
    );
    let mut bytes = state(0, "").encode().unwrap();
    bytes[4] = 9;
    let error = PlayerState::decode(&bytes).unwrap_err();
    assert!(matches!(error, StateError(FormatError::Version { found: 9, .. })), "{error}");
    bytes[4] = 2;
    *bytes.last_mut().unwrap() ^= 1;
    let error = PlayerState::decode(&bytes).unwrap_err().to_string();
    assert!(error.starts_with("state of the experiment is damaged: expected checksum "), "{error}");
}

/// Version 3 ends before the sessions.
#[test]
fn a_state_of_version_3_is_read_and_not_resumed() {
    let written = state(3, "ab").encode().unwrap();
    // Sessions that are all zero: two numbers in a byte each, and four of eight bytes.
    let body = &written[14..written.len() - 34];
    let mut bytes = b"FRPS\x03\x00".to_vec();
    bytes.extend_from_slice(&files::fnv1a(body).to_le_bytes());
    bytes.extend_from_slice(body);
    let read = PlayerState::decode(&bytes).unwrap();
    assert_eq!((read.session, read.text.as_str(), read.segment), (7, "ab", 3));
    assert!(!read.running);
}

/// Version 2 has epoch and client besides.
#[test]
fn a_state_of_version_2_is_read_and_not_resumed() {
    let body = b"\x07\x04demo\x02ab\x09\x03\x01\x0a\x0b";
    let mut bytes = b"FRPS\x02\x00".to_vec();
    bytes.extend_from_slice(&files::fnv1a(body).to_le_bytes());
    bytes.extend_from_slice(body);
    let state = PlayerState::decode(&bytes).unwrap();
    assert_eq!((state.session, state.name.as_str(), state.text.as_str()), (7, "demo", "ab"));
    assert_eq!((state.protocol, state.segment, state.running), (9, 3, false));
}

/// Version 1: header, then session, name, text, protocol, segment and running in bincode.
#[test]
fn a_state_of_version_1_is_read_and_not_resumed() {
    let body = b"\x07\x04demo\x02ab\x09\x03\x01";
    let mut bytes = b"FRPS\x01\x00".to_vec();
    bytes.extend_from_slice(&files::fnv1a(body).to_le_bytes());
    bytes.extend_from_slice(body);
    let state = PlayerState::decode(&bytes).unwrap();
    assert_eq!((state.session, state.name.as_str(), state.text.as_str()), (7, "demo", "ab"));
    assert_eq!((state.protocol, state.segment, state.running), (9, 3, false));
}

//! The kept state: what was written comes back, and damage is seen.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use experiment::scan_tracker::ScanState;
use experiment::session_state::SessionState;
use experiment::state::{PlayerState, StateError};
use files::FormatError;
use proptest::prelude::*;

/// Version of the format.
const VERSION: u8 = 6;

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
        pulses: "2,jitter=0.001,missing=3".parse().unwrap(),
        keys: vec![7, 9],
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
    bytes[4] = VERSION;
    *bytes.last_mut().unwrap() ^= 1;
    let error = PlayerState::decode(&bytes).unwrap_err().to_string();
    assert!(error.starts_with("state of the experiment is damaged: expected checksum "), "{error}");
}

/// A protocol that another version of farreach was playing is not resumed.
#[test]
fn a_state_of_another_version_is_refused() {
    for version in [1, VERSION - 1, VERSION + 1] {
        let mut bytes = state(3, "ab").encode().unwrap();
        bytes[4] = version;
        let error = PlayerState::decode(&bytes).unwrap_err();
        assert!(matches!(error, StateError(FormatError::Version { .. })), "{error}");
    }
}

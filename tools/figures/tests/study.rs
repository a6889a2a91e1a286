//! The whole study, as `farreach figures` shows it: what is published is all there, and what is
//! promised of it holds.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::collections::HashSet;

use figures::published::PUBLISHED;
use figures::study::study;

#[test]
fn every_published_value_has_its_row_and_ours_beside_it() {
    let study = study(|| ()).unwrap();
    let ids: HashSet<&str> = study.rows.iter().map(|row| row.id.as_str()).collect();
    assert_eq!(ids.len(), study.rows.len(), "an id twice");
    for published in PUBLISHED {
        let row = study.rows.iter().find(|row| row.id == published.id).expect(published.id);
        assert_eq!(
            (row.published, row.unit.as_str()),
            (Some(published.value), published.unit),
            "{}",
            published.id
        );
        let ours = [row.printed_constants, row.traced];
        assert!(ours.iter().flatten().all(|value| value.is_finite()), "{row:?}");
        // What the model has no constant for says so.
        let excused = row.note.is_some();
        assert!(excused || ours.iter().any(Option::is_some), "nothing of ours beside {row:?}");
    }
}

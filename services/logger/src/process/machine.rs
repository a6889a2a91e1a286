//! What a recording says of the machine that it was made on.

use std::collections::BTreeMap;
use std::path::Path;

use recording::mcap_write::key;
use runtime::RigName;
use runtime::machine_report::{MachineReport, unix_ms};

/// The newest report of `farreach doctor` for this rig: in one line, with its age now, and whole.
/// Where there is none, or it cannot be read, the line says so.
pub(super) fn doctor_report(folder: Option<&Path>, rig_name: &RigName) -> BTreeMap<String, String> {
    let newest = folder.map_or(Ok(None), |folder| MachineReport::newest(folder, rig_name));
    let (line, whole) = match newest {
        Ok(Some(report)) => (report.summary(unix_ms()), serde_json::to_string(&report).ok()),
        Ok(None) => ("no report".to_owned(), None),
        Err(error) => (format!("no report: {error}"), None),
    };
    let whole = whole.map(|text| (key::DOCTOR_REPORT.to_owned(), text));
    std::iter::once((key::DOCTOR.to_owned(), line)).chain(whole).collect()
}

/// The processors of the loops: `acquisition 0, control 1`; `None` where they are not placed.
pub(super) fn in_words(placement: &BTreeMap<String, usize>) -> Option<String> {
    let words: Vec<_> =
        placement.iter().map(|(process, number)| format!("{process} {number}")).collect();
    (!words.is_empty()).then(|| words.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recording_says_that_there_is_no_report() {
        let folder = tempfile::tempdir().unwrap();
        let name: RigName = "bench".parse().unwrap();
        for folder in [None, Some(folder.path())] {
            let found = doctor_report(folder, &name);
            assert_eq!(found, BTreeMap::from([("doctor".to_owned(), "no report".to_owned())]));
        }
        std::fs::write(MachineReport::file(folder.path(), &name), "{").unwrap();
        let found = doctor_report(Some(folder.path()), &name);
        assert!(found["doctor"].starts_with("no report: "), "{found:?}");
    }

    #[test]
    fn a_recording_holds_the_whole_report() {
        let folder = tempfile::tempdir().unwrap();
        let name: RigName = "bench".parse().unwrap();
        let text = r#"{"layout": 1, "taken_unix_ms": 0, "host": "h", "boot_id": "b", "user": 0,
            "version": "0.1.0", "revision": "r", "rig_name": "bench", "rig": null, "checks": []}"#;
        std::fs::write(MachineReport::file(folder.path(), &name), text).unwrap();
        let found = doctor_report(Some(folder.path()), &name);
        assert!(found["doctor"].contains("old, 0 pass, 0 warn, 0 fail"), "{found:?}");
        let whole: MachineReport = serde_json::from_str(&found["doctor_report"]).unwrap();
        assert_eq!(whole.host, "h");
    }

    #[test]
    fn the_placement_in_words() {
        assert_eq!(in_words(&BTreeMap::new()), None);
        let placed = BTreeMap::from([("control".to_owned(), 1), ("acquisition".to_owned(), 0)]);
        assert_eq!(in_words(&placed).unwrap(), "acquisition 0, control 1");
    }
}

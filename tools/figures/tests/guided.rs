//! The comparison of the laws of position control: what it promises of them holds.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use figures::guided::{Guided, HERTZ, LawKind, laws};
use lock_step::guided::Quality;

fn of(study: &Guided, law: LawKind, hertz: f64) -> Quality {
    study.cell(law, hertz).unwrap().quality.unwrap()
}

#[test]
fn each_law_does_what_it_is_for() {
    let study = laws(|| ()).unwrap();
    for hertz in HERTZ {
        let [feedback, printed, identified, observer, slave, all] = [
            LawKind::Feedback,
            LawKind::Printed,
            LawKind::Identified,
            LawKind::Observer,
            LawKind::Slave,
            LawKind::All,
        ]
        .map(|law| of(&study, law, hertz));
        for compensated in [printed, identified] {
            assert!(compensated.master_error < 0.6 * feedback.master_error, "{hertz} Hz");
            assert!(compensated.slave_error < 0.6 * feedback.slave_error, "{hertz} Hz");
        }
        assert!(observer.master_error < 0.5 * identified.master_error, "{hertz} Hz");
        for loops in [slave, all] {
            assert!(loops.slave_error < 0.5 * printed.slave_error, "{hertz} Hz");
            assert!(loops.plateau_s < 0.9 * printed.plateau_s, "{hertz} Hz");
        }
        for quality in [feedback, printed, identified, observer, slave, all] {
            assert!(
                quality.effort_v > 0.5 && quality.effort_v < 8.0 && quality.jerk > 0.0,
                "{hertz} Hz: {quality:?}"
            );
        }
    }
    // Rows: five numbers of each movement that there is, each id once.
    let rows = study.rows();
    let movements = study.cells.iter().filter(|cell| cell.quality.is_some()).count();
    assert_eq!(rows.len(), 5 * movements);
    assert!(rows.iter().any(|row| row.id == "hydrostatic.guided.0.2hz.pd_printed.error_deg"));
    assert!(
        rows.iter().all(|row| row.published.is_none() && row.traced.is_some_and(f64::is_finite))
    );
}

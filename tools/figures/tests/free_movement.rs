//! Free movement by itself: fig. 4.2's control at work, and what is said of it.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use figures::plots::free_movement::free_movement;

#[test]
fn what_the_hand_spends_stands_in_the_rows() {
    let drawn = free_movement().unwrap();
    let traced = |id: &str| {
        let row =
            drawn.rows.iter().find(|row| row.id == id).unwrap_or_else(|| panic!("no row {id}"));
        row.traced.expect(id)
    };
    for row in &drawn.rows {
        println!("{:70} {:?} {:?} {:?}", row.id, row.published, row.printed_constants, row.traced);
    }
    for hertz in ["0.5", "1", "2", "3"] {
        let of = |name: &str| traced(&format!("hydrostatic.free.{hertz}hz.{name}"));
        assert!(
            of("hand_torque_rms_nm") < 0.75 * of("uncompensated_hand_torque_rms_nm"),
            "{hertz} Hz"
        );
        assert!(
            of("hand_torque_peak_nm") < 0.9 * of("uncompensated_hand_torque_peak_nm"),
            "{hertz} Hz"
        );
        assert!(of("torque_ripple_nm") > 0.0);
    }
    // What the caption says: possible at 3 Hz, and work.
    assert_eq!(traced("hydrostatic.force_control.free_movement_hz"), 3.0);
    assert!((traced("hydrostatic.force_control.free_movement_deg") - 120.0).abs() < 3.0);
    assert!(traced("hydrostatic.free.3hz.hand_torque_rms_nm") > 3.0);
    // The more the cell tells of the torque, the less is left of it, while the loop is stable.
    let (plain, twice) = (
        traced("hydrostatic.free.3hz.hand_torque_rms_nm"),
        traced("own.free.sensitivity_twice.3hz.hand_torque_rms_nm"),
    );
    assert!(twice < 0.9 * plain, "{twice} of {plain}");
}

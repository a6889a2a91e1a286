//! Fig. 3.2: the friction laws.

use anyhow::Result;
use plant::hydrostatic::Parameters;
use report::Panels;

use super::style::curve;
use super::{Common, Plot};
use crate::published::published;
use crate::quasi_static::quasi_static_cycle;
use crate::simulated_line::Line;
use crate::table_row::{Role, Row};

/// Fastest speed drawn, rad/s: the peak of a 3 Hz movement of ±60°.
const FASTEST_RAD_S: f64 = 20.0;

/// Fig. 3.2.
///
/// # Errors
/// Where a constant is out of range.
pub fn laws(common: &Common) -> Result<Plot> {
    let printed = Parameters::printed();
    // Speed 0 twice: friction jumps there from one breakaway to the other.
    let speeds: Vec<f64> =
        (0..=800).map(|step| FASTEST_RAD_S * (f64::from(step) / 400.0 - 1.0)).collect();
    let law = |level: &dyn Fn(f64) -> f64| -> (Vec<f64>, Vec<f64>) {
        let mut points: Vec<(f64, f64)> = Vec::new();
        for speed in &speeds {
            if *speed == 0.0 {
                points.extend([(0.0, -level(0.0)), (0.0, level(0.0))]);
            } else {
                points.push((*speed, speed.signum() * level(*speed)));
            }
        }
        points.into_iter().unzip()
    };
    let motor = law(&|speed| printed.motor_coulomb_nm + printed.motor_viscous_nm_s * speed.abs());
    let piston = law(&|speed| 1e3 * printed.master_piston_friction().level(speed));
    let slave = law(&|speed| printed.slave_friction().level(speed));

    const MEASURED: [&str; 2] = [
        "hydrostatic.static_friction_measured.positive_nm",
        "hydrostatic.static_friction_measured.negative_nm",
    ];
    let measured = [published(MEASURED[0])?.value, published(MEASURED[1])?.value];
    let at_motor = printed.static_friction_at_motor_nm();
    let slow_printed = quasi_static_cycle(&Line::printed())?.mean_nm;
    let slow_traced = quasi_static_cycle(&common.calibration.line)?.mean_nm;
    let panel = |title: &str, side: &str, unit: &str, (speed, friction): &(Vec<f64>, Vec<f64>)| {
        let (x_label, y_label) =
            (format!("{side} speed / (rad/s)"), format!("friction / ({unit})"));
        curve(title, &x_label, &y_label, speed, friction)
    };
    let panels = Panels::new("Fig. 3.2, friction laws")
        .panel(panel("A  Motor", "master", "N·m", &motor).y_range(-1.0, 1.0))
        .panel(panel("B  Slave", "slave", "N·m", &slave))
        .panel(panel("B  Master piston, on its pulley", "master", "mN·m", &piston));
    let caption = format!(
        "Friction against speed as § 3.2.1 prints it, with the sign of speed that the print leaves \
            out. Friction at rest takes any value up to the jump at zero. The master piston's is a \
            hundredth of the motor's. At the motor, breaking the slave loose takes {at_motor:.2} \
            N·m by these constants; § 5.2.2 measured {} to {} N·m.",
        measured[0], measured[1]
    );
    let note = "mean magnitude of the motor's torque in one direction, master along a sine of \
        0.008 Hz, ±30°";
    let slow = |direction: usize| [Some(slow_printed[direction]), Some(slow_traced[direction])];
    let traced = common.calibration.line.parameters.static_friction_at_motor_nm();
    let volts = [at_motor, traced].map(|torque| Some(torque / printed.motor_torque_per_volt_nm));
    let rows = vec![
        Row::beside(MEASURED[0], Role::Predicted, slow(0))?.note(note),
        Row::beside(MEASURED[1], Role::Predicted, slow(1))?
            .note(format!("{note}; the model's friction does not depend on the direction")),
        Row::beside("hydrostatic.static_friction_voltage_measured.value_v", Role::Input, volts)?
            .note("the motor's torque per volt is assumed from this value"),
        Row::own("own.static_friction_at_motor_nm", "3.2", "N·m", [Some(at_motor); 2])
            .note("0.767 + 0.2 · 0.031 + 2.30 · 0.854, § 3.2.1's constants"),
    ];
    Ok(Plot { number: "3.2", title: "Friction laws", caption, panels, rows })
}

//! Fig. 3.2: the friction laws.

use plant::hydrostatic::Parameters;
use report::{Colour, Sheet};

use super::style::axes;
use super::{Common, Drawn};
use crate::error::Result;
use crate::line::Line;
use crate::measure::Rig;
use crate::published::published;
use crate::row::{Role, Row};
use plant::transmission::{ImposedMotion, Transmission};

/// Fastest speed drawn, rad/s: the peak of a 3 Hz movement of ±60°.
const FASTEST_RAD_S: f64 = 20.0;

/// Fig. 3.2.
///
/// # Errors
/// Where a constant is out of range.
pub fn laws(common: &Common) -> Result<Drawn> {
    let printed = Parameters::printed();
    // Speed 0 twice: friction jumps there from one breakaway to the other.
    let speeds: Vec<f64> = (0..=800).map(|step| FASTEST_RAD_S * (f64::from(step) / 400.0 - 1.0)).collect();
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
    let (motor_speed, motor) = law(&|speed| printed.motor_coulomb_nm + printed.motor_viscous_nm_s * speed.abs());
    let (piston_speed, piston) = law(&|speed| 1e3 * printed.master_piston_friction().level(speed));
    let (slave_speed, slave) = law(&|speed| printed.slave_friction().level(speed));

    let measured = published("hydrostatic.static_friction_measured.positive_nm")?;
    let measured_back = published("hydrostatic.static_friction_measured.negative_nm")?;
    let volts = published("hydrostatic.static_friction_voltage_measured.value_v")?;
    let at_motor = printed.static_friction_at_motor_nm();
    let slow_printed = slow_movement_torque(&Line::printed())?;
    let slow_traced = slow_movement_torque(&common.tracing.line)?;
    let sheet = Sheet::new("Fig. 3.2, friction laws")
        .panel(
            axes("A  Motor", "master speed / (rad/s)", "friction / (N·m)")
                .y_range(-1.0, 1.0)
                .colour(Colour::Blue)
                .line("", &motor_speed, &motor),
        )
        .panel(axes("B  Slave", "slave speed / (rad/s)", "friction / (N·m)").colour(Colour::Blue).line(
            "",
            &slave_speed,
            &slave,
        ))
        .panel(
            axes("B  Master piston, on its pulley", "master speed / (rad/s)", "friction / (mN·m)")
                .colour(Colour::Blue)
                .line("", &piston_speed, &piston),
        );
    let caption = format!(
        "Friction against speed as § 3.2.1 prints it, with the sign of speed that the print leaves out. Friction at rest takes \
         any value up to the jump at zero. The master piston's is a hundredth of the motor's. At the motor, breaking the slave \
         loose takes {at_motor:.2} N·m by these constants; § 5.2.2 measured {} to {} N·m.",
        measured.value, measured_back.value
    );
    let note = "mean magnitude of the motor's torque while the slave moves, master along a sine of 0.008 Hz";
    let rows = vec![
        Row::beside(measured, Role::Predicted, Some(slow_printed), Some(slow_traced)).note(note),
        Row::beside(measured_back, Role::Predicted, Some(slow_printed), Some(slow_traced))
            .note(format!("{note}; the model's friction does not depend on the direction")),
        Row::beside(
            volts,
            Role::Input,
            Some(at_motor / printed.motor_torque_per_volt_nm),
            Some(common.tracing.line.parameters.static_friction_at_motor_nm() / printed.motor_torque_per_volt_nm),
        )
        .note("the motor's torque per volt is assumed from this value"),
        Row::own("own.static_friction_at_motor_nm", "3.2", "N·m", Some(at_motor), Some(at_motor))
            .note("0.767 + 0.2 · 0.031 + 2.30 · 0.854, § 3.2.1's constants"),
    ];
    Ok(Drawn { number: "3.2", title: "Friction laws", caption, sheet, rows })
}

/// Frequency of § 5.2.2's slow movement, Hz.
const SLOW_HZ: f64 = 0.008;
/// Step along it, s.
const SLOW_STEP_S: f64 = 2e-3;

/// Mean torque of the motor while the slave moves, N·m, the master moved along a very slow sine (fig. 5.5).
fn slow_movement_torque(line: &Line) -> Result<f64> {
    let mut plant = line.plant()?;
    let (amplitude, omega) = (line.amplitude_rad(), std::f64::consts::TAU * SLOW_HZ);
    // From rest at one end: half a cycle, over which the speed has one sign.
    let steps = (0.5 / (SLOW_HZ * SLOW_STEP_S)) as usize;
    let (mut sum, mut count) = (0.0, 0.0);
    for step in 1..=steps {
        let (sine, cosine) = (omega * step as f64 * SLOW_STEP_S).sin_cos();
        let target =
            ImposedMotion { position_rad: amplitude * (1.0 - cosine), velocity_rad_s: amplitude * omega * sine };
        plant.step_imposed(target, 0.0, SLOW_STEP_S);
        // The first tenth only stretches the line.
        if step > steps / 10 {
            sum += plant.motion().motor_torque_nm;
            count += 1.0;
        }
    }
    Ok(sum / count)
}

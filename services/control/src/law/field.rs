//! Force fields (§ 4.2): the torque that the hand is to feel, as a function of the handle's
//! position, velocity and acceleration.
//!
//! On one axis: spring (a negative one is divergent), damper, inertia, tables over position and
//! velocity, walls. Across axes: constant matrices; a curl field is the antisymmetric part of the
//! damping matrix. A torque is positive in the positive direction of its axis.

use ipc_types::{AXES, Setpoint, TABLE};

use super::within;

/// Motion of the handle on all axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Handle {
    /// Position (rad or m).
    pub position: [f64; AXES],
    /// Velocity (rad/s or m/s): difference quotient of its encoder, low-pass filtered at the axis's
    /// `velocity_filter_hz`.
    pub velocity: [f64; AXES],
    /// Acceleration (rad/s² or m/s²): difference quotient of that velocity, low-pass filtered at
    /// [`rig::ACCELERATION_HZ`].
    pub acceleration: [f64; AXES],
}

/// Torque of a setpoint's force field on an axis (N·m or N).
///
/// The inertia term is limited to ± `most_inertia` (N·m or N).
pub fn field_torque(setpoint: &Setpoint, axis: usize, handle: &Handle, most_inertia: f64) -> f64 {
    let mut torque = 0.0;
    let mut inertia = 0.0;
    for other in 0..AXES {
        let entry = axis * AXES + other;
        torque -= setpoint.stiffness[entry] * (handle.position[other] - setpoint.position[other])
            + setpoint.damping[entry] * handle.velocity[other];
        inertia -= setpoint.inertia[entry] * handle.acceleration[other];
    }
    let position = handle.position[axis];
    let entries = axis * TABLE..(axis + 1) * TABLE;
    let (least, most) = (setpoint.table_position_min[axis], setpoint.table_position_max[axis]);
    if most > least {
        torque +=
            at(&setpoint.position_table[entries.clone()], (position - least) / (most - least));
    }
    let speed = setpoint.table_speed[axis];
    if speed > 0.0 {
        torque += at(&setpoint.velocity_table[entries], 0.5 + 0.5 * handle.velocity[axis] / speed);
    }
    if setpoint.wall_stiffness[axis] > 0.0 {
        let inside = position.max(setpoint.wall_min[axis]).min(setpoint.wall_max[axis]);
        torque -= setpoint.wall_stiffness[axis] * (position - inside);
    }
    torque + within(inertia, most_inertia)
}

/// Linear interpolation in evenly spaced values at `share` (0 to 1) of their range; constant beyond
/// the ends.
fn at(values: &[f64], share: f64) -> f64 {
    // NaN stays NaN, and the law then releases the output.
    let place = share.clamp(0.0, 1.0) * values.len().saturating_sub(1) as f64;
    let below = place as usize;
    let (Some(from), to) = (values.get(below), values.get(below + 1)) else { return 0.0 };
    from + to.map_or(0.0, |to| (place - below as f64) * (to - from))
}

/// Whether all numbers of a setpoint's force field are finite.
pub(super) fn is_finite(setpoint: &Setpoint) -> bool {
    let Setpoint { position, wall_min, wall_max, wall_stiffness, .. } = setpoint;
    let Setpoint { table_position_min, table_position_max, table_speed, .. } = setpoint;
    let Setpoint { stiffness, damping, inertia, position_table, velocity_table, .. } = setpoint;
    let axes = [
        position,
        wall_min,
        wall_max,
        wall_stiffness,
        table_position_min,
        table_position_max,
        table_speed,
    ];
    let matrices = [stiffness, damping, inertia].into_iter().flatten();
    let tables = [position_table, velocity_table].into_iter().flatten();
    axes.into_iter().flatten().chain(matrices).chain(tables).all(|number| number.is_finite())
}

//! Converts the force field of a segment into a setpoint.

use ipc_types::{AXES, Setpoint, TABLE};
use rig::protocol::{Field, MATRIX_AXES, POINTS, TorqueTable};

// Tables and matrices of a protocol and of a setpoint have the same size.
const _: () = assert!(POINTS == TABLE && MATRIX_AXES == AXES);

/// Writes the force field of one axis, and its matrices over several axes, into a setpoint.
pub(crate) fn put(setpoint: &mut Setpoint, axis: usize, field: &Field) {
    if let Some(matrix) = &field.matrix {
        for row in 0..AXES {
            for column in 0..AXES {
                let entry = row * AXES + column;
                setpoint.stiffness[entry] = matrix.stiffness[row][column];
                setpoint.damping[entry] = matrix.damping[row][column];
                setpoint.inertia[entry] = matrix.inertia[row][column];
            }
        }
        // With a matrix there is no separate spring, so all centres are the matrix's.
        setpoint.position[..matrix.axes].copy_from_slice(&matrix.centres[..matrix.axes]);
    }
    let diagonal = axis * (AXES + 1);
    setpoint.stiffness[diagonal] += field.stiffness;
    setpoint.damping[diagonal] += field.damping;
    setpoint.inertia[diagonal] += field.inertia;
    let entries = axis * TABLE..(axis + 1) * TABLE;
    if let Some(TorqueTable { least, most, torques }) = field.position_table.as_deref() {
        setpoint.position_table[entries.clone()].copy_from_slice(torques);
        (setpoint.table_position_min[axis], setpoint.table_position_max[axis]) = (*least, *most);
    }
    if let Some(TorqueTable { most, torques, .. }) = field.velocity_table.as_deref() {
        setpoint.velocity_table[entries].copy_from_slice(torques);
        setpoint.table_speed[axis] = *most;
    }
    if let Some((least, most)) = field.walls {
        setpoint.wall_min[axis] = least;
        setpoint.wall_max[axis] = most;
        setpoint.wall_stiffness[axis] = field.wall_stiffness;
    }
}

//! The axis of a rig that is identified: chosen by name or number, with its columns of a record.

use recording::record::column_of;
use rig::RigFile;

use crate::error::{IdentifyError, Result};

/// The index of the axis asked for by name, or by number from 0. A rig with one axis, or none,
/// needs none to be named.
///
/// # Errors
/// [`IdentifyError::Usage`] if there is no such axis, or if one of several has to be named.
pub fn chosen_axis(rig: &RigFile, asked: Option<&str>) -> Result<usize> {
    let names: Vec<&str> = rig.axes.iter().map(|axis| axis.name.as_str()).collect();
    let list = || {
        let named = names.iter().enumerate().map(|(index, name)| format!("\"{name}\" ({index})"));
        named.collect::<Vec<_>>().join(", ")
    };
    let file = rig.file_name();
    let Some(asked) = asked else {
        return match names.len() {
            0 | 1 => Ok(0),
            several => Err(IdentifyError::Usage(format!(
                "{file} has {several} axes: {}; one is identified at a time: name it with --axis",
                list()
            ))),
        };
    };
    let by_name = names.iter().position(|name| *name == asked);
    let by_number = || asked.parse::<usize>().ok().filter(|index| *index < names.len());
    by_name.or_else(by_number).ok_or_else(|| {
        let known = if names.is_empty() { "none".to_owned() } else { list() };
        IdentifyError::Usage(format!("--axis {asked}: expected an axis of {file}: {known}"))
    })
}

/// Gives the columns of the axis the names that they have in a record of one axis: in a file of
/// several axes they begin with its name (`flexion.motor_v`).
///
/// # Errors
/// If a column occurs under both names.
pub(crate) fn own_columns(
    file: &str,
    axis: &str,
    of_model: &[&str],
    columns: &mut [(String, Vec<f64>)],
) -> Result<()> {
    for column in of_model {
        let long = column_of(axis, column);
        let Some(at) = columns.iter().position(|(name, _)| *name == long) else { continue };
        if columns.iter().any(|(name, _)| name == column) {
            return Err(IdentifyError::Unusable(format!(
                "{file}: expected either a column `{column}` or a column `{long}`, found both; \
                 take one out"
            )));
        }
        (*column).clone_into(&mut columns[at].0);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn rig(name: &str) -> RigFile {
        let path = format!("{}/../../launch/rigs/{name}.toml", env!("CARGO_MANIFEST_DIR"));
        rig::load_declaration(path.as_ref()).unwrap()
    }

    #[test]
    fn an_axis_is_named_or_numbered_where_there_are_several() {
        let (one, two) = (rig("hydrostatic"), rig("two-axis"));
        assert_eq!(chosen_axis(&one, None).unwrap(), 0);
        assert_eq!(chosen_axis(&one, Some("0")).unwrap(), 0);
        assert_eq!(chosen_axis(&two, Some("rotation")).unwrap(), 1);
        assert_eq!(chosen_axis(&two, Some("1")).unwrap(), 1);
        for asked in [None, Some("2"), Some("rotatoin"), Some("-1")] {
            let error = chosen_axis(&two, asked).unwrap_err();
            assert!(matches!(error, IdentifyError::Usage(_)), "{error}");
            let text = error.to_string();
            assert!(text.contains("two-axis.toml"), "{text}");
            assert!(text.contains("\"flexion\" (0), \"rotation\" (1)"), "{text}");
        }
        // A file that declares a model alone has no axis to be named.
        let none = rig("silverbox");
        assert_eq!(chosen_axis(&none, None).unwrap(), 0);
    }

    #[test]
    fn columns_of_the_axis_lose_its_name_and_others_keep_theirs() {
        let columns = |names: &[&str]| -> Vec<(String, Vec<f64>)> {
            names.iter().map(|name| ((*name).to_owned(), vec![1.0])).collect()
        };
        let model = ["t_s", "motor_v", "slave_rad"];
        let mut found = columns(&["t_s", "a.motor_v", "a.slave_rad", "b.slave_rad"]);
        own_columns("run.csv", "a", &model, &mut found).unwrap();
        let names: Vec<&str> = found.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, ["t_s", "motor_v", "slave_rad", "b.slave_rad"]);

        let mut twice = columns(&["t_s", "a.motor_v", "motor_v"]);
        let error = own_columns("run.csv", "a", &model, &mut twice).unwrap_err().to_string();
        assert!(error.contains("`motor_v`") && error.contains("`a.motor_v`"), "{error}");
    }
}

//! Why data or a rig file cannot be used.

/// Everything here ends the program with exit code 1.
#[derive(Debug, thiserror::Error)]
pub enum IdentifyError {
    /// Records of several axes: nobody says which of them a model's parameters belong to.
    #[error(
        "{file}: [[axes]]: expected one axis, found {axes}; identify one axis at a time, with a \
         rig file that has it alone"
    )]
    Axes {
        /// The rig file.
        file: String,
        /// Number of axes.
        axes: usize,
    },
    /// Machines that lack nothing can be simulated of transmissions that turn only.
    #[error(
        "{file}: --calibrate: expected a transmission with an axis in rad, found a model of kind \
         \"{kind}\" with an axis in {unit}; records of others are not simulated: leave --calibrate \
         out"
    )]
    NotSimulated {
        /// The rig file.
        file: String,
        /// What it declares.
        kind: String,
        /// Unit of its axis.
        unit: &'static str,
    },
    /// A declared parameter is missing.
    #[error(
        "{file}: [model.parameters]: expected `{name}` for a model of kind `{kind}`, found \
         {found}; add it with its value and tolerance"
    )]
    Parameter {
        /// The rig file.
        file: String,
        /// The model's kind.
        kind: &'static str,
        /// The parameter.
        name: &'static str,
        /// What is declared.
        found: String,
    },
    /// A declared value makes no sense.
    #[error("{file}: [model.parameters] {name} = {value}: expected {expected}")]
    Value {
        /// The rig file.
        file: String,
        /// The parameter.
        name: &'static str,
        /// What is declared.
        value: f64,
        /// What would do.
        expected: &'static str,
    },
    /// A column is missing.
    #[error(
        "{file}: expected a column {expected}, found {found}; SI units, names as in `farreach \
         identify --help`"
    )]
    Column {
        /// The record.
        file: String,
        /// What was wanted.
        expected: String,
        /// The columns that are there.
        found: String,
    },
    /// `--map` names a column that the model does not have.
    #[error(
        "--map {column}=...: expected one of the columns {known} of a model of kind \"{kind}\"; \
         correct the name on the left of the equals sign"
    )]
    MappedColumn {
        /// The name on the left.
        column: String,
        /// Columns of the model.
        known: String,
        /// The model's kind.
        kind: &'static str,
    },
    /// The recording was made on another machine.
    #[error(
        "{file}: expected a recording of {expected} (by {rig_file}), found one of {found}; give \
         the rig file of the machine that was recorded, or, if it is the same machine, give both \
         rig files the same name, kind and unit"
    )]
    OtherMachine {
        /// The recording.
        file: String,
        /// The rig file.
        rig_file: String,
        /// The machine of the rig file.
        expected: String,
        /// The machine of the recording.
        found: String,
    },
    /// One value cannot be used.
    #[error("{file}, row {row}, column `{column}`: found {found}, expected {expected}; {advice}")]
    Cell {
        /// The record.
        file: String,
        /// Row of data, the first below the header being 1.
        row: usize,
        /// The column.
        column: String,
        /// What is there.
        found: String,
        /// What would do.
        expected: String,
        /// What to do.
        advice: &'static str,
    },
    /// A column as a whole cannot be used.
    #[error("{file}, column `{column}`: {found}; {advice}")]
    Channel {
        /// The record.
        file: String,
        /// The column.
        column: String,
        /// What is wrong.
        found: String,
        /// What to do.
        advice: String,
    },
    /// Too little data.
    #[error("{file}: {found}, expected {expected}; record for longer")]
    Short {
        /// The record.
        file: String,
        /// What is there.
        found: String,
        /// What would do.
        expected: String,
    },
    /// `--fit`, `--select`, `--report-on` do not fit together.
    #[error("{what}; {advice}")]
    Roles {
        /// What is wrong.
        what: String,
        /// What to do.
        advice: &'static str,
    },
    /// A record could not be read; the text names file, row and column.
    #[error("{0}")]
    Read(String),
    /// The declared model cannot be simulated along the records at all.
    #[error(
        "{file}: the declared model diverges from these records for all parameters within their \
         tolerances; expected records of this rig: check the rig file, the units and the signs of \
         the columns"
    )]
    Lost {
        /// The records.
        file: String,
    },
    /// The equations could not be solved.
    #[error(
        "{file}: the columns {columns} cannot be told apart in the rows that take part in the fit; \
         excite the machine more"
    )]
    Singular {
        /// The records.
        file: String,
        /// The columns of the regression.
        columns: String,
    },
}

impl IdentifyError {
    /// [`Self::Channel`].
    pub(crate) fn channel(
        file: &str,
        column: &str,
        found: impl Into<String>,
        advice: impl Into<String>,
    ) -> Self {
        let (file, column) = (file.to_owned(), column.to_owned());
        Self::Channel { file, column, found: found.into(), advice: advice.into() }
    }
}

/// What the functions of this crate return.
pub type Result<T> = std::result::Result<T, IdentifyError>;

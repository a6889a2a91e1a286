//! Which controller computes the output of an axis.

use ipc_types::Mode;

/// A controller. From one to another the transfer is bumpless.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Controller {
    /// Position control with the options of the rig file.
    #[default]
    Position,
    /// Position control without them.
    Search,
    /// Force control.
    Force,
}

impl Controller {
    /// The controller of a mode, in modes that are not force controlled. While the handle is driven
    /// against its stops, or its zero is not known, the options would act on what is not there: the
    /// slave does not follow the reference, its position counts from another zero than the
    /// master's, and what compensates friction at a stop lets the line spring back from it.
    pub(super) const fn of(mode: Mode, homed: bool) -> Self {
        if matches!(mode, Mode::Initialise) || !homed { Self::Search } else { Self::Position }
    }
}

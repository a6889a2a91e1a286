"""Errors of this package."""


class FarreachError(Exception):
    """Any error of this package."""


class RigNotUp(FarreachError):
    """No rig of that name is up."""


class RigEnded(FarreachError):
    """The rig went down, or another one of the same name came up."""


class NoSuchTopic(FarreachError):
    """There is no topic of that name."""


class LayoutError(FarreachError):
    """A message is not laid out as its schema says, or as this package expects."""


class RecordingError(FarreachError):
    """A recording cannot be read."""

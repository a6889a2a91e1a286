"""Live data and recordings of a farreach haptic interface.

    import farreach

    with farreach.connect() as rig:
        samples = rig.subscribe("sample")
        block = samples.read(seconds=1.0)       # a numpy array, one element per sample
        print(block["master_position"][:, 0].mean(), samples.lost)

    run = farreach.open_recording("run.mcap")
    frame = run.frame("sample")                 # a pandas DataFrame
"""

from .errors import (
    FarreachError,
    LayoutError,
    NoSuchTopic,
    RecordingError,
    RigEnded,
    RigNotUp,
)
from .layout import Layout, layout_of, topics
from .live import Rig, Subscription, connect
from .recording import Recording, open_recording

__all__ = [
    "FarreachError",
    "Layout",
    "LayoutError",
    "NoSuchTopic",
    "Recording",
    "RecordingError",
    "Rig",
    "RigEnded",
    "RigNotUp",
    "Subscription",
    "connect",
    "layout_of",
    "open_recording",
    "topics",
]

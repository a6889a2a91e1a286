"""Recordings of a rig: MCAP files with messages of every topic."""

import tomllib
from pathlib import Path

import numpy as np
from mcap.reader import make_reader

from .errors import FarreachError, NoSuchTopic, RecordingError
from .layout import CDR_HEADER, parse

START_RECORD = "farreach"
RUN_RECORD = "farreach.run"


def open_recording(path):
    """Opens a recording. Raises `RecordingError` where it is none, or was cut off."""
    return Recording(path)


class Recording:
    """A whole recording. Arrays are read when they are asked for, and checksums with them."""

    def __init__(self, path):
        self.path = Path(path)
        summary, records = self._open(lambda reader: (
            reader.get_summary(), [(each.name, each.metadata) for each in reader.iter_metadata()]
        ))
        if summary is None or summary.statistics is None:
            raise RecordingError(
                f"{self.path}: the file has no summary; make a whole one of it: "
                f"farreach rec recover {self.path} -o NEW.mcap"
            )
        self._channels = summary.channels
        self._schemas = summary.schemas
        self._counts = summary.statistics.channel_message_counts
        starts = [content for name, content in records if name == START_RECORD]
        self.metadata = dict(starts[0]) if starts else {}
        """What the recording says about itself, as text: rig, profile, revision, and more."""
        self._began_ns = None
        self.runs = [dict(content) for name, content in records if name == RUN_RECORD]
        """The protocols that were played, in order: name, text, subject."""

    @property
    def topics(self):
        """Number of messages by topic; topics without any are left out."""
        counts = {}
        for number, channel in self._channels.items():
            counts[channel.topic] = counts.get(channel.topic, 0) + self._counts.get(number, 0)
        return {topic: count for topic, count in sorted(counts.items()) if count}

    @property
    def rig(self):
        """The rig file that the recording was made with, as a dictionary."""
        text = self.metadata.get("rig_file")
        if text is None:
            raise RecordingError(f"{self.path}: no rig file in it: farreach did not write it")
        return tomllib.loads(text)

    def layout(self, topic):
        """The layout of a topic's messages in this recording."""
        layouts = {}
        for channel in self._channels.values():
            if channel.topic == topic:
                schema = self._schemas[channel.schema_id]
                name = schema.name.rpartition("/")[2]
                layouts[schema.data] = parse(name, schema.data.decode())
        if not layouts:
            known = ", ".join(self.topics) or "none"
            raise NoSuchTopic(f"{self.path}: no topic \"{topic}\"; it has {known}")
        dtypes = {str(layout.dtype) for layout in layouts.values()}
        if len(dtypes) > 1:
            raise RecordingError(
                f"{self.path}: topic {topic} changes its fields within the file, which was merged "
                f"of several versions: read the parts one by one"
            )
        return next(iter(layouts.values()))

    def array(self, topic):
        """All messages of a topic in the order of time: a structured array with a field for each
        field of the message."""
        return self._read(topic)[0]

    @property
    def began_ns(self):
        """When the first message came after the recording was begun, by the wall clock (ns since
        1970); `None` without messages. The times of `farreach rec` count from it."""
        if self._began_ns is None:
            try:
                record = self.metadata
                started_ns = int(record["started_ns"]) + int(record["realtime_offset_ns"])
            except (KeyError, ValueError):
                started_ns = 0
            # Events of before, which a topic keeps for those who come late, are in it, too.
            first = self._open(
                lambda reader: next(iter(reader.iter_messages(starting_at=started_ns)), None)
            )
            self._began_ns = first and first[2].log_time
        return self._began_ns

    def frame(self, topic):
        """All messages of a topic as a pandas DataFrame. Its index is the wall-clock time of
        publishing (UTC); arrays spread over columns `NAME_0`, `NAME_1`, ..., and `seconds` counts
        from `began_ns`."""
        try:
            import pandas
        except ImportError as error:
            raise FarreachError(
                "frames need pandas: pip install \"farreach[pandas]\""
            ) from error
        array, log_time_ns = self._read(topic)
        columns = {"seconds": (log_time_ns - (self.began_ns or 0)) * 1e-9}
        for name in array.dtype.names:
            values = array[name]
            if values.ndim == 1:
                columns[name] = values
            else:
                columns.update({f"{name}_{at}": values[:, at] for at in range(values.shape[1])})
        index = pandas.DatetimeIndex(
            pandas.to_datetime(log_time_ns, unit="ns", utc=True), name="time"
        )
        return pandas.DataFrame(columns, index=index)

    def _read(self, topic):
        """Messages, and when each was published (ns since 1970)."""
        layout = self.layout(topic)
        size = len(CDR_HEADER) + layout.size

        def read(reader):
            bodies, times = bytearray(), []
            for _, _, message in reader.iter_messages(topics=[topic]):
                if len(message.data) < size or message.data[: len(CDR_HEADER)] != CDR_HEADER:
                    raise RecordingError(
                        f"{self.path}: topic {topic}, sequence {message.sequence}: expected "
                        f"little-endian CDR of {size} bytes, found {len(message.data)} bytes that "
                        f"begin with {message.data[:4].hex(' ')}"
                    )
                bodies += message.data[len(CDR_HEADER) : size]
                times.append(message.log_time)
            return np.frombuffer(bodies, dtype=layout.dtype), np.array(times, dtype=np.int64)

        return self._open(read)

    def _open(self, read):
        """What `read` makes of a reader; its errors say which file, and what to do."""
        try:
            file = open(self.path, "rb")
        except OSError as error:
            raise RecordingError(f"{self.path}: cannot read: {error.strerror}") from error
        with file:
            try:
                return read(make_reader(file, validate_crcs=True))
            except FarreachError:
                raise
            except Exception as error:
                # A damaged file shows in whatever decoded it: reader, decompression, checksum.
                raise RecordingError(
                    f"{self.path}: {error or 'the file ends too early'}; is it a whole recording? "
                    f"`farreach rec verify` tells what is wrong, `farreach rec recover` keeps what "
                    f"can be read"
                ) from error

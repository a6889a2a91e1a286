"""Compares a recording with what the readers of other projects decode.

    check.py RECORDING.mcap EXPECTED.jsonl

EXPECTED has one JSON object a line, in the order of the file: topic, type, log_time_ns, sequence,
fields (numbers that are not finite as text). `cargo run -p recording --example reader_check` writes
such a pair; `farreach rec cat --json` gives the same lines for any recording (without `type`, which
is then not compared).

Every field of every message is read with `mcap` + `mcap-ros2-support` and with `rosbags`, and
compared bit by bit.
Exit code 1 and the first differences on stderr if anything differs.
"""

import json
import struct
import sys
from pathlib import Path

from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

SHOWN = 10
NOT_FINITE = {"NaN": float("nan"), "inf": float("inf"), "-inf": float("-inf")}


class Comparison:
    """Collects the differences that one reader shows."""

    def __init__(self, reader):
        self.reader = reader
        self.differences = []
        self.values = 0

    def expect(self, where, expected, found):
        self.values += 1
        if bits(expected) != bits(found):
            difference = f"{where}: expected {expected!r}, found {found!r}"
            self.differences.append(f"{self.reader}: {difference}")

    def message(self, number, expected, topic, kind, log_time, fields):
        where = f"message {number} ({expected['topic']})"
        self.expect(f"{where} topic", expected["topic"], topic)
        if "type" in expected:
            self.expect(f"{where} type", expected["type"], kind)
        self.expect(f"{where} log time", expected["log_time_ns"], log_time)
        for name, wanted in expected["fields"].items():
            found = fields(name)
            if not isinstance(wanted, list):
                self.expect(f"{where} {name}", wanted, found)
                continue
            found = list(found)
            self.expect(f"{where} {name} length", len(wanted), len(found))
            for index, (one, other) in enumerate(zip(wanted, found)):
                self.expect(f"{where} {name}[{index}]", one, other)


def bits(value):
    """Numbers by their bits, so that -0.0 differs from 0.0; all NaN are equal."""
    if isinstance(value, str):
        value = NOT_FINITE.get(value, value)
    if hasattr(value, "item"):
        value = value.item()
    if isinstance(value, float):
        return "NaN" if value != value else struct.pack("<d", value)
    return value


def with_mcap(path, expected):
    comparison = Comparison("mcap-ros2-support")
    with open(path, "rb") as stream:
        # raises on a wrong checksum
        for _ in StreamReader(stream, validate_crcs=True).records:
            pass
        stream.seek(0)
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        messages = list(reader.iter_decoded_messages(log_time_order=False))
    comparison.expect("number of messages", len(expected), len(messages))
    for number, (wanted, found) in enumerate(zip(expected, messages)):
        decoded = found.decoded_message
        comparison.message(
            number,
            wanted,
            found.channel.topic,
            found.schema.name,
            found.message.log_time,
            lambda name: getattr(decoded, name),
        )
        sequence = wanted["sequence"] & 0xFFFFFFFF
        comparison.expect(f"message {number} sequence", sequence, found.message.sequence)
        names = set(getattr(decoded, "__slots__", wanted["fields"]))
        comparison.expect(f"message {number} fields", sorted(wanted["fields"]), sorted(names))
    return comparison


def with_rosbags(path, expected):
    comparison = Comparison("rosbags")
    store = get_typestore(Stores.EMPTY)
    by_topic = {}
    for line in expected:
        by_topic.setdefault(line["topic"], []).append(line)
    with Reader(Path(path)) as reader:
        for connection in reader.connections:
            store.register(get_types_from_msg(connection.msgdef.data, connection.msgtype))
        comparison.expect("number of messages", len(expected), reader.message_count)
        # in the order of log time, which within a topic is that of the file
        seen = dict.fromkeys(by_topic, 0)
        for connection, time, raw in reader.messages():
            decoded = store.deserialize_cdr(raw, connection.msgtype)
            number = seen[connection.topic]
            seen[connection.topic] += 1
            kind = connection.msgtype
            comparison.message(
                number,
                by_topic[connection.topic][number],
                connection.topic,
                kind,
                time,
                lambda name: getattr(decoded, name),
            )
        for topic, lines in by_topic.items():
            comparison.expect(f"messages of {topic}", len(lines), seen[topic])
    # the reader that most people use finds the types by itself
    with AnyReader([Path(path)]) as reader:
        connection, _, raw = next(reader.messages())
        reader.deserialize(raw, connection.msgtype)
    return comparison


def main(arguments):
    if len(arguments) != 2:
        print(__doc__, file=sys.stderr)
        return 2
    path, lines = arguments
    expected = [json.loads(line) for line in Path(lines).read_text(encoding="utf-8").splitlines()]
    if not expected:
        print(f"{lines}: nothing to compare", file=sys.stderr)
        return 1
    failed = False
    for read in (with_mcap, with_rosbags):
        comparison = read(path, expected)
        for difference in comparison.differences[:SHOWN]:
            print(difference, file=sys.stderr)
        if comparison.differences:
            failed = True
            count = len(comparison.differences)
            print(f"{comparison.reader}: {count} differences", file=sys.stderr)
        else:
            counts = f"{len(expected)} messages, {comparison.values} values"
            print(f"{comparison.reader}: {counts}, all equal")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

"""Writes and reads recordings with the MCAP library for Python, to be measured beside farreach.

    recordings.py write SOURCE OUT     the messages of SOURCE anew, compressed by lz4
    recordings.py summary FILE         the end of the file alone
    recordings.py read FILE            every message, with the chunks' checksums
    recordings.py table FILE OUT       every field of the topic `sample` as CSV
"""

import csv
import json
import os
import sys
import time

from mcap.reader import SeekingReader
from mcap.writer import CompressionType, Writer
from mcap_ros2.decoder import DecoderFactory

CHUNK_BYTES = 1024 * 1024


def write(source, out):
    with open(source, "rb") as stream:
        recorded = list(SeekingReader(stream).iter_messages(log_time_order=False))
    began, used = time.monotonic(), time.process_time()
    with open(out, "xb") as stream:
        writer = Writer(stream, chunk_size=CHUNK_BYTES, compression=CompressionType.LZ4)
        writer.start(profile="ros2")
        channels = {}
        for schema, channel, message in recorded:
            if channel.id not in channels:
                known = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, known)
            writer.add_message(channels[channel.id], message.log_time, message.data,
                               message.publish_time, message.sequence)
        writer.finish()
        stream.flush()
        os.fdatasync(stream.fileno())
    return {"messages": len(recorded), "s": time.monotonic() - began,
            "processor_s": time.process_time() - used, "bytes": os.path.getsize(out)}


def summary(file):
    with open(file, "rb") as stream:
        statistics = SeekingReader(stream).get_summary().statistics
    return {"messages": statistics.message_count, "topics": statistics.channel_count,
            "seconds": (statistics.message_end_time - statistics.message_start_time) / 1e9}


def read(file):
    messages = payload = 0
    with open(file, "rb") as stream:
        reader = SeekingReader(stream, validate_crcs=True)
        for _, _, message in reader.iter_messages(log_time_order=False):
            messages += 1
            payload += len(message.data)
    return {"messages": messages, "payload_bytes": payload}


def table(file, out):
    rows = 0
    with open(file, "rb") as stream, open(out, "x", newline="", encoding="ascii") as to:
        reader = SeekingReader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        lines, names = csv.writer(to), None
        for *_, message in reader.iter_decoded_messages(topics=["sample"]):
            if names is None:
                # Constants are upper case.
                names = [name for name in message.__slots__ if name.islower()]
                lines.writerow(column for name in names for column in columns(message, name))
            cells = []
            for name in names:
                value = getattr(message, name)
                if isinstance(value, (int, float)):
                    cells.append(value)
                else:
                    cells.extend(value)
            lines.writerow(cells)
            rows += 1
    return {"messages": rows}


def columns(message, name):
    """Names of a field's columns."""
    value = getattr(message, name)
    if isinstance(value, (int, float)):
        return [name]
    return [f"{name}_{index}" for index in range(len(value))]


def main():
    commands = {"write": write, "summary": summary, "read": read, "table": table}
    if len(sys.argv) < 3 or sys.argv[1] not in commands:
        sys.exit(__doc__)
    print(json.dumps(commands[sys.argv[1]](*sys.argv[2:])))


main()

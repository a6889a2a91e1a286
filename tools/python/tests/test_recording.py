"""Recordings, against what `farreach rec` says of the same file.

FARREACH_TEST_RECORDING names a recording, FARREACH_TEST_PROGRAM the program; without them these
tests are skipped.
"""

import collections
import csv
import io
import json
import os
import subprocess
import tempfile
import unittest
from pathlib import Path

import numpy as np
from mcap.reader import make_reader

import farreach

RECORDING = os.environ.get("FARREACH_TEST_RECORDING")
PROGRAM = os.environ.get("FARREACH_TEST_PROGRAM")


def rec(*arguments):
    """What the program prints."""
    return subprocess.run([PROGRAM, "rec", *arguments], check=True, stdout=subprocess.PIPE,
                          text=True).stdout


class NoRecordingTest(unittest.TestCase):
    def test_what_is_no_whole_recording_is_refused_with_what_to_do(self):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "run.mcap"
            with self.assertRaisesRegex(farreach.RecordingError, "No such file"):
                farreach.open_recording(path)
            for content in (b"", b"time,volts\n0,1\n", b"\x89MCAP0\r\n"):
                path.write_bytes(content)
                with self.subTest(content=content), \
                        self.assertRaisesRegex(farreach.RecordingError, "run.mcap.*farreach rec"):
                    farreach.open_recording(path)


@unittest.skipUnless(RECORDING and PROGRAM, "FARREACH_TEST_RECORDING names no recording")
class RecordingTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.run_ = farreach.open_recording(RECORDING)

    def test_every_value_of_every_topic_is_that_of_the_export(self):
        self.assertGreater(self.run_.topics["sample"], 1000)
        for topic, count in self.run_.topics.items():
            with self.subTest(topic=topic):
                rows = csv.DictReader(io.StringIO(
                    rec("export", RECORDING, "--to", "csv", "--topic", topic)))
                columns = collections.defaultdict(list)
                for row in rows:
                    for name, text in row.items():
                        columns[name].append(text)
                frame = self.run_.frame(topic)
                self.assertEqual(len(frame), count)
                for name, texts in columns.items():
                    if name == "log_time_ns":
                        found = frame.index.astype(np.int64).to_numpy()
                    elif name == "text":
                        found = self.run_.layout(topic).texts(self.run_.array(topic))
                        self.assertEqual(list(found), texts)
                        continue
                    else:
                        found = frame[name].to_numpy()
                    expected = np.array(texts).astype(found.dtype)
                    np.testing.assert_array_equal(found, expected, name)

    def test_metadata_are_those_of_info(self):
        self.assertEqual(self.run_.metadata["rig_file"],
                         rec("info", RECORDING, "--text", "rig_file"))
        self.assertEqual(self.run_.rig["rates"]["acquisition_hz"], 2000)

    def test_time_counts_from_the_beginning_as_info_does(self):
        info = json.loads(rec("info", RECORDING, "--json"))
        first_ns = {topic["topic"]: topic["first_ns"] for topic in info["topics"]}
        for topic in self.run_.topics:
            seconds = self.run_.frame(topic)["seconds"]
            expected = (first_ns[topic] - info["began_ns"]) * 1e-9
            self.assertAlmostEqual(seconds.iloc[0], expected, 6, topic)

    def test_an_unknown_topic_is_told_with_those_there_are(self):
        with self.assertRaisesRegex(farreach.NoSuchTopic, "no topic \"samples\".*command"):
            self.run_.array("samples")

    def test_a_torn_or_altered_file_is_refused(self):
        whole = Path(RECORDING).read_bytes()
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "run.mcap"
            path.write_bytes(whole[: len(whole) // 2])
            with self.assertRaisesRegex(farreach.RecordingError, "farreach rec recover"):
                farreach.open_recording(path)
            altered = bytearray(whole)
            with open(RECORDING, "rb") as file:
                chunks = make_reader(file).get_summary().chunk_indexes
            chunk = max(chunks, key=lambda chunk: chunk.chunk_length)
            altered[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 0x10
            path.write_bytes(altered)
            recording = farreach.open_recording(path)
            with self.assertRaisesRegex(farreach.RecordingError, "farreach rec recover"):
                for topic in recording.topics:
                    recording.array(topic)


if __name__ == "__main__":
    unittest.main()

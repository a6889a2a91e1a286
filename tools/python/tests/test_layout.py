"""Schemas and the layouts read from them."""

import ctypes
import unittest

import numpy as np

import farreach
from farreach.layout import parse


class LayoutTest(unittest.TestCase):
    def test_every_topic_has_a_layout_that_c_agrees_with(self):
        self.assertIn("sample", farreach.topics())
        for topic in farreach.topics():
            with self.subTest(topic=topic):
                layout = farreach.layout_of(topic)
                structure = layout.structure()
                self.assertRegex(layout.type_name, r"^farreach\.\w+\.v\d+$")
                self.assertEqual(structure.type_name(), layout.type_name)
                for name in layout.dtype.names:
                    offset = layout.dtype.fields[name][1]
                    self.assertEqual(getattr(structure, name).offset, offset, name)
                self.assertEqual(layout.dtype.names[:4],
                                 ("session", "incarnation", "sequence", "time_ns"))

    def test_units_and_codes_are_those_of_the_schema(self):
        sample = farreach.layout_of("sample")
        self.assertIn("(rad or m)", sample.descriptions["master_position"])
        self.assertEqual(sample.dtype["master_position"].shape, (3,))
        self.assertEqual(sample.names("gate_state", [0, 2, 9]),
                         ["closed", "latched closed", "unknown code 9"])
        with self.assertRaisesRegex(farreach.LayoutError, "tick holds no codes"):
            sample.names("tick", [0])

    def test_fields_are_aligned_as_in_cdr(self):
        layout = parse("Odd", "uint8 one\nfloat64 two\nuint16[3] three\n")
        offsets = [layout.dtype.fields[name][1] for name in layout.dtype.names]
        self.assertEqual(offsets, [0, 8, 16])
        self.assertIsNone(layout.type_name)

    def test_texts_end_at_the_padding(self):
        layout = farreach.layout_of("event/watchdog")
        events = np.zeros(2, layout.dtype)
        events["text"][0][:5] = np.frombuffer("größ".encode()[:5], np.uint8)
        self.assertEqual(layout.texts(events)[1], "")
        self.assertTrue(layout.texts(events)[0].startswith("gr"))
        with self.assertRaisesRegex(farreach.LayoutError, "holds no text"):
            layout.texts(events, "kind")

    def test_what_is_no_number_is_refused(self):
        for line in ("string name", "float64[] values", "geometry_msgs/Point at", "float64[<=3] x"):
            with self.subTest(line=line), self.assertRaisesRegex(farreach.LayoutError, "expected"):
                parse("Bad", f"{line}\n")
        head = "# farreach/msg/Bad: 9 bytes, farreach.Bad.v1 in shared memory. Generated.\n\n"
        with self.assertRaisesRegex(farreach.LayoutError, "expected 9 bytes, found fields of 8"):
            parse("Bad", head + "float64 x\n")

    def test_an_unknown_topic_is_told_with_those_there_are(self):
        with self.assertRaisesRegex(farreach.NoSuchTopic, "no topic \"samples\".*sample"):
            farreach.layout_of("samples")

    def test_a_structure_holds_what_numpy_reads(self):
        layout = farreach.layout_of("command")
        command = layout.structure()()
        command.volts[1] = 2.5
        command.mode = 5
        array = np.frombuffer(ctypes.string_at(ctypes.addressof(command), layout.size),
                              layout.dtype)
        self.assertEqual(array["volts"][0].tolist(), [0.0, 2.5, 0.0])
        self.assertEqual(layout.names("mode", array["mode"]), ["centre"])


if __name__ == "__main__":
    unittest.main()

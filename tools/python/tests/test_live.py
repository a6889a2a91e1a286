"""A rig that is up.

FARREACH_RIG_NAME names a simulated rig that may be taken down, and FARREACH_TEST_PROGRAM the
program; without them these tests are skipped. A process observes one rig, so they are one test.
"""

import itertools
import os
import subprocess
import unittest

import numpy as np

import farreach

RIG = os.environ.get("FARREACH_RIG_NAME")
PROGRAM = os.environ.get("FARREACH_TEST_PROGRAM")


class NoRigTest(unittest.TestCase):
    def test_a_rig_that_is_not_up_is_told(self):
        with self.assertRaisesRegex(farreach.RigNotUp, "no rig \"nobody-here\".*farreach up"):
            farreach.connect("nobody-here")


@unittest.skipUnless(RIG and PROGRAM, "FARREACH_RIG_NAME names no rig")
class LiveTest(unittest.TestCase):
    def test_a_rig_from_samples_to_its_end(self):
        with farreach.connect() as rig:
            samples = rig.subscribe("sample")
            block = samples.read(count=4000)
            self.assertEqual(len(block), 4000)
            self.assertEqual(block.dtype, farreach.layout_of("sample").dtype)
            self.assertTrue((block["session"] == rig.session).all())
            # Gaps in the ticks are those that were counted, and no other.
            steps = np.diff(block["sequence"].astype(np.int64))
            self.assertEqual(int((steps - 1).sum()), samples.lost)
            self.assertTrue((steps > 0).all())
            self.assertEqual(samples.received, 4000)

            newest = samples.latest()
            self.assertGreater(newest["sequence"], block["sequence"][-1])

            # One that does not read loses what its buffer (1024 samples) cannot hold, and knows.
            slow = rig.subscribe("sample")
            first = slow.read(count=1)["sequence"][0]
            samples.read(count=3000)
            last = slow.read()["sequence"][-1]
            self.assertGreater(slow.lost, 1000)
            self.assertEqual(slow.received + slow.lost, int(last) - int(first) + 1)
            slow.close()
            with self.assertRaisesRegex(farreach.FarreachError, "closed"):
                slow.read()

            # Events of before come, too, as this topic has a history. Of the two verbs at least
            # one changes the state.
            events = rig.subscribe("event/watchdog")
            for verb in ("estop", "reset"):
                subprocess.run([PROGRAM, verb], check=False, stdout=subprocess.DEVNULL,
                               stderr=subprocess.DEVNULL)
            kinds = []
            for part in itertools.islice(events.blocks(0.2), 50):
                kinds += events.layout.names("kind", part["kind"])
                if "state changed" in kinds:
                    break
            self.assertIn("state changed", kinds)

            with self.assertRaises(farreach.NoSuchTopic):
                rig.subscribe("samples")
            with self.assertRaisesRegex(farreach.FarreachError, "can join no other"):
                other = farreach.Rig.__new__(farreach.Rig)
                other._read_session = lambda: rig.session + 1
                other._has_keeper = lambda: True
                other.__init__(rig.name)

            subprocess.run([PROGRAM, "down"], check=True, stdout=subprocess.DEVNULL)
            with self.assertRaisesRegex(farreach.RigEnded, RIG):
                for _ in samples.blocks(0.1):
                    pass
            self.assertFalse(rig.is_up())


if __name__ == "__main__":
    unittest.main()

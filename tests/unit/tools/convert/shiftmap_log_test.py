#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Tests of the Python writer, against the C++ reader and writer.

Usage: shiftmap_log_test.py ROOT CONVERT PRINTER, with the paths of the checkout, of shiftmap-convert
and of mcap_reference_tool.
"""

import json
import pathlib
import struct
import subprocess
import sys
import tempfile
import unittest

ROOT, CONVERT, PRINTER = map(pathlib.Path, sys.argv[1:4])
PYTHON = ROOT / "tools/convert/python"
sys.dont_write_bytecode = True
sys.path.insert(0, str(PYTHON))
import shiftmap_log  # noqa: E402


def bits(*values):
    return " ".join(struct.pack(">d", value).hex() for value in values)


class WriterTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.log = self.folder / "run.mcap"

    def printed(self):
        return subprocess.run([PRINTER, "print", self.log], check=True, capture_output=True,
                              text=True).stdout.splitlines()

    def test_reader_gives_what_was_written_bit_by_bit(self):
        with shiftmap_log.Writer(self.log, vehicle="é", area="hall", source="test") as log:
            log.odometry(-5, 0.1, -1 / 3)
            log.odometry(10**9, 0.0, 1e-300)
            log.scan(10**9, [])
            log.scan(9 * 10**18 // 2, [
                shiftmap_log.range_bearing("L1", 1 / 7, -3.0),
                shiftmap_log.position("", -1.5, 0.0, covariance=(0.25, 0.0625, 0.5)),
            ])
        self.assertEqual(self.printed(), [
            "info [é] [test]",
            f"-5 odometry {bits(0.1, -1 / 3)}",
            f"1000000000 odometry {bits(0.0, 1e-300)}",
            "1000000000 scan",
            f"4500000000000000000 scan [L1] polar {bits(1 / 7, -3.0)} "
            f"[] cartesian {bits(-1.5, 0.0, 0.25, 0.0625, 0.5)}",
        ])

    def test_schema_is_that_of_the_cpp_writer(self):
        odometry = self.folder / "odometry.csv"
        odometry.write_text("stamp_s,v_mps,omega_radps\n1,0,0\n")
        observations = self.folder / "observations.csv"
        observations.write_text("stamp_s,signature,range_m,bearing_rad\n1,L,2,0\n")
        subprocess.run([CONVERT, "csv", "--odometry", odometry, "--observations", observations,
                        "--output", self.log, "--quiet"], check=True, capture_output=True)
        self.assertIn(shiftmap_log.descriptor_set(), self.log.read_bytes())

    def test_what_is_not_closed_is_read_up_to_its_last_second(self):
        log = shiftmap_log.Writer(self.log, vehicle="v")
        for i in range(100):
            log.odometry(i * 10**8, 1.0, 0.0)
        # A process that is killed here has written all that is on the disk now.
        self.log.write_bytes(self.log.read_bytes())
        stream = subprocess.run([PRINTER, "print", self.log], capture_output=True, text=True)
        lines = stream.stdout.splitlines()
        self.assertEqual(len(lines), 1 + 90)
        self.assertIn("ends early", stream.stderr)
        log.close()

    def test_refuses_what_a_log_may_not_hold(self):
        with shiftmap_log.Writer(self.log, vehicle="v") as log:
            log.odometry(10, 1.0, 0.0)
            with self.assertRaisesRegex(ValueError, "stamp 9 ns after one of 10 ns"):
                log.odometry(9, 1.0, 0.0)
            with self.assertRaisesRegex(ValueError, "v_mps is nan"):
                log.odometry(11, float("nan"), 0.0)
            with self.assertRaisesRegex(ValueError, "range 0 m"):
                log.scan(11, [shiftmap_log.range_bearing("L", 0, 0.0)])
        self.assertEqual(len(self.printed()), 2)

    def test_example_is_a_good_log(self):
        subprocess.run([sys.executable, "-B", PYTHON / "example.py", self.log], check=True)
        check = subprocess.run([CONVERT, "check", "--json", self.log], check=True,
                               capture_output=True, text=True)
        document = json.loads(check.stdout)
        self.assertEqual(document["findings"], [])
        self.assertEqual(document["signatures"], 6)
        self.assertGreater(document["motion_pairs"], 30)
        self.assertLess(document["motion_misfit"], 1e-6)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])

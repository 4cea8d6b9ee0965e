#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Logs a robot that drives two rounds among six landmarks. Usage: example.py RUN.mcap

A real recorder takes velocities from the wheels and observations from the detector, each with the
stamp of its measurement.
"""

import math
import sys

import shiftmap_log

LANDMARKS = {f"L{i}": (7 * math.cos(i), 7 * math.sin(i)) for i in range(1, 7)}
BEGIN_NS = 1_767_600_000 * 10**9
V_MPS, OMEGA_RADPS = 1.0, 0.25


def seen_from(x, y, yaw):
    """The landmarks ahead, at most 8 m away."""
    for name, (landmark_x, landmark_y) in LANDMARKS.items():
        range_m = math.hypot(landmark_x - x, landmark_y - y)
        bearing_rad = math.remainder(math.atan2(landmark_y - y, landmark_x - x) - yaw, math.tau)
        if range_m < 8 and abs(bearing_rad) < 1:
            yield shiftmap_log.range_bearing(name, range_m, bearing_rad)


def main():
    radius_m = V_MPS / OMEGA_RADPS
    with shiftmap_log.Writer(sys.argv[1], vehicle="example", area="hall") as log:
        for step in range(1000):  # 50 s, 20 times a second
            stamp_ns = BEGIN_NS + step * 50_000_000
            log.odometry(stamp_ns, V_MPS, OMEGA_RADPS)
            if step % 4 == 0:
                yaw = OMEGA_RADPS * step * 0.05
                x, y = radius_m * math.sin(yaw), radius_m * (1 - math.cos(yaw))
                log.scan(stamp_ns, seen_from(x, y, yaw))


if __name__ == "__main__":
    main()

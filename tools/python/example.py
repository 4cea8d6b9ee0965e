# SPDX-License-Identifier: Apache-2.0
# %% [markdown]
# # A map whose landmarks move, as arrays
# Cells as editors with notebooks know them. To make the data:
#
#     shiftmap-sim open world --shifts 4 --groups 12 --modes 2 --duration-s 120 --seed 7
#     shiftmap-mapper build --store world/maps.db --area floor world/run_00[0-2].mcap
#
# %%
import sys

import numpy as np

import shiftmap

world = sys.argv[1] if len(sys.argv) > 1 and not sys.argv[1].startswith("-") else "world"
np.set_printoptions(precision=2, suppress=True)

# %% The published map, when the last run of it ended
store = shiftmap.Store(f"{world}/maps.db")
log = shiftmap.read_run_log(f"{world}/run_003.mcap")
begin_s = log.odometry_ns[0] * 1e-9
floor = store.load("floor", at=begin_s)
print(floor)

# %% Landmarks of which two places are known, and how sure the map is of the likelier one
names, first, counts = np.unique(floor.signatures.astype(str), return_index=True, return_counts=True)
for name, row, count in zip(names, first, counts):
    if count > 1:
        p = floor.probabilities[row : row + count]
        where = floor.positions[row + p.argmax()]
        print(f"{name}: mode {floor.modes[row + p.argmax()]} of {count} at {where.round(1)}, p = {p.max():.2f}")

# %% The largest 95 % ellipse
half_axes = np.sqrt(5.991 * np.linalg.eigvalsh(floor.covariances)[:, 1])
print(f"largest half axis {half_axes.max():.1f} m")

# %% One landmark's past: which visits say what, and the probabilities day by day
name = names[counts > 1][0]
days = begin_s - 86400.0 * np.arange(3)[::-1]
history = store.history("floor", name, at=begin_s, track=days)
visits = history.visits
for run, mode, log_odds in zip(visits["run_name"], visits["likely_mode"], visits["log_odds"]):
    print(f"{name} in {run}: mode {mode}, log-odds {log_odds:.0f}")
print(f"modes {history.modes}, probabilities by day:\n{history.track}")

# %% The next shift on this map
shift = shiftmap.replay(floor, f"{world}/run_003.mcap")
print(f"{len(shift.poses)} poses, {len(shift.decisions['mode'])} decisions, localized: {shift.localized}")
states = {state: round(seconds) for state, seconds in shift.seconds_in_state.items() if seconds}
print(states)
print(f"mean NIS {shift.innovations['nis'].mean():.1f} of 2 expected")

# %% Errors say what kind they are
try:
    store.load("roof")
except shiftmap.ShiftmapError as error:
    print(error.category, error.exit_code)

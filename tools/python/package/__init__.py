# SPDX-License-Identifier: Apache-2.0
"""Maps of places whose landmarks move, from Python: read-only.

Stores, maps and histories of landmarks, run logs, and shifts replayed on a map, as NumPy arrays.
Metres, radians, seconds; stamps are nanoseconds since the Unix epoch, `int64`, names ending in
`_ns`: `stamps_ns.view("datetime64[ns]")` are times. Errors are `ShiftmapError`.
"""

from ._native import (
    History,
    Map,
    Replay,
    RunLog,
    ShiftmapError,
    Store,
    __version__,
    read_run_log,
    replay,
)

__all__ = [
    "History",
    "Map",
    "Replay",
    "RunLog",
    "ShiftmapError",
    "Store",
    "__version__",
    "read_run_log",
    "replay",
]

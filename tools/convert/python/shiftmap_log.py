# SPDX-License-Identifier: Apache-2.0
"""Writes run logs of shiftmap. One file, Python 3.8 or later, nothing else needed: copy it.

    with shiftmap_log.Writer("run.mcap", vehicle="agv-3", area="hall") as log:
        log.odometry(stamp_ns, v_mps, omega_radps)
        log.scan(stamp_ns, [shiftmap_log.range_bearing("L07", range_m, bearing_rad)])

Stamps are nanoseconds since 1970, UTC; angles are counter-clockwise, in radians; x is forward and y
to the left of the vehicle. Items come in the order of their stamps. A scan that saw nothing is
logged too: it tells that a landmark is gone. A closed chunk is on the disk: a power cut loses the
last second.
"""

import math
import struct
import uuid
import zlib

_DOUBLE, _INT64, _STRING, _MESSAGE, _SINT32 = 1, 3, 9, 11, 17  # FieldDescriptorProto.Type
_ONE, _MANY = 1, 3  # FieldDescriptorProto.Label

# proto/run_log.proto: number, name, type, and whether it is repeated or one of a choice.
_MESSAGES = {
    "RunInfo": [(1, "vehicle", _STRING), (2, "source", _STRING), (3, "run_uuid", _STRING),
                (4, "area", _STRING)],
    "Odometry": [(1, "stamp_ns", _INT64), (2, "v_mps", _DOUBLE), (3, "omega_radps", _DOUBLE)],
    "LandmarkScan": [(1, "stamp_ns", _INT64), (2, "observation", "LandmarkObservation", "many")],
    "LandmarkObservation": [(1, "signature", _STRING),
                            (2, "range_bearing", "RangeBearing", "measurement"),
                            (3, "position_in_vehicle", "PositionInVehicle", "measurement"),
                            (4, "covariance", "Covariance2")],
    "RangeBearing": [(1, "range_m", _DOUBLE), (2, "bearing_rad", _DOUBLE)],
    "PositionInVehicle": [(1, "x_m", _DOUBLE), (2, "y_m", _DOUBLE)],
    "Covariance2": [(1, "c00", _DOUBLE), (2, "c01", _DOUBLE), (3, "c11", _DOUBLE)],
    "LidarScan": [(1, "stamp_ns", _INT64), (2, "field_of_view_rad", _DOUBLE),
                  (3, "max_range_m", _DOUBLE), (4, "lidar_x_m", _DOUBLE), (5, "lidar_y_m", _DOUBLE),
                  (6, "lidar_yaw_rad", _DOUBLE), (7, "range_step_mm", _SINT32, "many")],
}
_TOPICS = {"RunInfo": "/run_info", "Odometry": "/odometry", "LandmarkScan": "/landmarks"}

_MAGIC = b"\x89MCAP0\r\n"
_CHUNK_BYTES = 256 << 10
_CHUNK_NS = 10**9


def range_bearing(signature, range_m, bearing_rad, covariance=None):
    """A landmark by distance and direction; covariance (rr, rb, bb) in m², m·rad, rad²."""
    if not range_m > 0:
        raise ValueError(f"landmark '{signature}': range {range_m} m, expected above 0")
    return _observation(signature, "range_bearing",
                        {"range_m": range_m, "bearing_rad": bearing_rad}, covariance)


def position(signature, x_m, y_m, covariance=None):
    """A landmark by its place in the vehicle frame; covariance (xx, xy, yy) in m²."""
    return _observation(signature, "position_in_vehicle", {"x_m": x_m, "y_m": y_m}, covariance)


class Writer:
    """A run log that is open for writing.

    vehicle is unique in the fleet; area is the map that the run is in, if known. The run's identity,
    run_uuid, is drawn here unless the recorder has drawn one.
    """

    def __init__(self, path, vehicle, area="", source="shiftmap_log.py", run_uuid=None):
        self._file = open(path, "wb")
        self._crc = 0
        self._chunk, self._chunk_times = bytearray(), []
        self._last_ns = None
        self._sequence = dict.fromkeys(_TOPICS, 0)
        self._info = {"vehicle": vehicle, "source": source, "area": area,
                      "run_uuid": str(run_uuid or uuid.uuid4())}
        self._write(_MAGIC + _record(0x01, _string("") + _string("shiftmap_log.py")))
        schema = descriptor_set()
        for number, (message, topic) in enumerate(_TOPICS.items(), start=1):
            self._write(_record(0x03, struct.pack("<H", number) + _string("shiftmap.proto." + message)
                                + _string("protobuf") + _string(schema)))
            self._write(_record(0x04, struct.pack("<HH", number, number) + _string(topic)
                                + _string("protobuf") + _string("")))

    def odometry(self, stamp_ns, v_mps, omega_radps):
        """The velocity from stamp_ns on: forward [m/s], and counter-clockwise [rad/s]."""
        self._item("Odometry", {"stamp_ns": stamp_ns, "v_mps": v_mps, "omega_radps": omega_radps})

    def scan(self, stamp_ns, observations):
        """All that one scan saw, from range_bearing() and position(); also nothing."""
        self._item("LandmarkScan", {"stamp_ns": stamp_ns, "observation": list(observations)})

    def close(self):
        """Ends the file. A log that is not closed can be read up to its last chunk."""
        if self._file.closed:
            return
        self._end_chunk()
        self._write(_record(0x0F, struct.pack("<I", self._crc)))
        self._write(_record(0x02, struct.pack("<QQI", 0, 0, 0)) + _MAGIC)
        self._file.close()

    def __enter__(self):
        return self

    def __exit__(self, *unused):
        self.close()

    def _item(self, message, values):
        stamp_ns = values["stamp_ns"]
        if self._last_ns is not None and stamp_ns < self._last_ns:
            raise ValueError(f"stamp {stamp_ns} ns after one of {self._last_ns} ns")
        data = _encode(message, values)
        if self._last_ns is None:
            self._message("RunInfo", stamp_ns, _encode("RunInfo", self._info))
        self._last_ns = stamp_ns
        self._message(message, stamp_ns, data)

    def _message(self, message, stamp_ns, data):
        time_ns = max(stamp_ns, 0)
        if self._chunk_times and (time_ns - self._chunk_times[0] >= _CHUNK_NS
                                  or len(self._chunk) >= _CHUNK_BYTES):
            self._end_chunk()
        channel = list(_TOPICS).index(message) + 1
        head = struct.pack("<HIQQ", channel, self._sequence[message], time_ns, time_ns)
        self._sequence[message] += 1
        self._chunk += _record(0x05, head + data)
        self._chunk_times.append(time_ns)

    def _end_chunk(self):
        if not self._chunk:
            return
        head = struct.pack("<QQQI", self._chunk_times[0], self._chunk_times[-1], len(self._chunk),
                           zlib.crc32(self._chunk))
        self._write(_record(0x06, head + _string("") + struct.pack("<Q", len(self._chunk))
                            + self._chunk))
        self._file.flush()
        self._chunk, self._chunk_times = bytearray(), []

    def _write(self, data):
        self._file.write(data)
        self._crc = zlib.crc32(data, self._crc)


def descriptor_set():
    """proto/run_log.proto as a FileDescriptorSet, which tells any MCAP tool what messages hold."""
    file = _field(1, b"proto/run_log.proto") + _field(2, b"shiftmap.proto")
    for name, fields in _MESSAGES.items():
        message, choices = _field(1, name.encode()), []
        for number, field, kind, *more in fields:
            label = _MANY if more == ["many"] else _ONE
            text = _field(1, field.encode()) + _field(3, number) + _field(4, label)
            text += _field(5, kind if isinstance(kind, int) else _MESSAGE)
            if isinstance(kind, str):
                text += _field(6, f".shiftmap.proto.{kind}".encode())
            if more and more != ["many"]:
                choices += [] if more[0] in choices else more
                text += _field(9, choices.index(more[0]))
            message += _field(2, text)
        for choice in choices:
            message += _field(8, _field(1, choice.encode()))
        file += _field(4, message)
    return _field(1, file + _field(12, b"proto3"))


def _observation(signature, kind, measurement, covariance):
    observation = {"signature": signature, kind: measurement}
    if covariance is not None:
        observation["covariance"] = dict(zip(("c00", "c01", "c11"), covariance))
    return observation


def _encode(message, values):
    """A message as Protobuf bytes."""
    out = b""
    for number, name, kind, *_ in _MESSAGES[message]:
        if name not in values:
            continue
        value = values[name]
        for item in value if isinstance(value, list) else [value]:
            if kind == _DOUBLE:
                if not math.isfinite(item):
                    raise ValueError(f"{name} is {item}, expected a finite number")
                out += _varint(number << 3 | 1) + struct.pack("<d", item)
            elif kind == _INT64:
                out += _field(number, int(item))
            elif kind == _STRING:
                out += _field(number, item.encode())
            else:
                out += _field(number, _encode(kind, item))
    return out


def _field(number, value):
    """A field that holds a whole number or bytes."""
    if isinstance(value, int):
        return _varint(number << 3) + _varint(value)
    return _varint(number << 3 | 2) + _varint(len(value)) + value


def _varint(value):
    value &= (1 << 64) - 1
    out = bytearray()
    while value >= 0x80:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def _string(text):
    data = text.encode() if isinstance(text, str) else text
    return struct.pack("<I", len(data)) + data


def _record(opcode, content):
    return struct.pack("<BQ", opcode, len(content)) + bytes(content)

#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Fetches an area's map from a map server and submits a shift report, with nothing but the .proto
files that shiftmap installs (Debian: python3-grpcio, protobuf-compiler-grpc):

    protoc -I /usr/share/shiftmap --python_out=. --grpc_out=. \\
        --plugin=protoc-gen-grpc=$(command -v grpc_python_plugin) \\
        proto/map_server.proto proto/shift_report.proto
    fetch_and_submit.py HOST:PORT AREA MAP.db SHIFT.report [CA.pem CERT.pem KEY.pem]
"""
import hashlib
import pathlib
import sys

import grpc
from proto import map_server_pb2, map_server_pb2_grpc

address, area, output, report, *tls = sys.argv[1:]
if tls:
    ca, certificate, key = (pathlib.Path(path).read_bytes() for path in tls)
    channel = grpc.secure_channel(address, grpc.ssl_channel_credentials(ca, key, certificate))
else:
    channel = grpc.insecure_channel(address)
server = map_server_pb2_grpc.MapServerStub(channel)

parts = server.FetchSnapshot(map_server_pb2.FetchSnapshotRequest(area=area))
snapshot = next(parts).snapshot
data = b"".join(part.data for part in parts)
if hashlib.sha256(data).hexdigest() != snapshot.sha256:
    sys.exit("the snapshot's hash is another one: fetch it again")
pathlib.Path(output).write_bytes(data)
print(f"area {snapshot.area} version {snapshot.version}: {len(data)} bytes")

request = map_server_pb2.SubmitReportRequest()
request.report.ParseFromString(pathlib.Path(report).read_bytes())
answer = server.SubmitReport(request)
print(f"report {request.report.uuid}: {answer.evidence_rows} rows, duplicate: {answer.duplicate}")

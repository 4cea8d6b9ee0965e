#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Builds the image of tools/packaging/Containerfile and runs its server and its nightly job. Where no
# registry is reached, a local Debian root stands in for the base image, and without a kernel that
# runs containers a chroot does. Where buildah is absent it says so and ends with 0.
# Usage: tools/packaging/test_container.sh ROOT.tar DEBS WORLD LOG
#   ROOT.tar  a Debian root with apt    DEBS   a folder with the packages of one version
#   WORLD     of shiftmap-sim           LOG    file for what the tools say
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
root=$1 debs=$2 world=$3 log=$4

command -v buildah >/dev/null || { echo "packages: the image is not built: buildah is not installed"; exit 0; }
[[ $EUID == 0 ]] || { echo "packages: the image is not built: that takes root"; exit 0; }

work=$(mktemp --directory)
server=
# To the server itself, as a runtime sends it, which is the last of the processes that run it.
stop_server() {
  local leaf=$server child
  while child=$(pgrep --parent "$leaf" | head --lines=1) && [[ -n $child ]]; do leaf=$child; done
  kill -TERM "$leaf" 2>/dev/null || true
}
cleanup() {
  [[ -z $server ]] || stop_server
  wait
  rm -rf "$work"
}
trap cleanup EXIT
fail() {
  tail -n 5 "$work"/*.log >&2 2>/dev/null || true
  echo "packages: $*" >&2
  exit 1
}
export BUILDAH_ISOLATION=chroot
image() { buildah --storage-driver vfs --root "$work/storage" --runroot "$work/run" "$@"; }

base=$(image from scratch)
image add --quiet "$base" "$root" / >>"$log" 2>&1
image commit --quiet --rm "$base" docker.io/library/debian:bookworm-slim >>"$log" 2>&1
image build --pull-never --tag shiftmap --file tools/packaging/Containerfile "$debs" >>"$log" 2>&1 ||
  fail "the image is not built: $log"
container=$(image from --pull-never shiftmap)

# A site: its certificates are readable for the image's user only, by the number that is documented.
site=$work/site
mkdir -p "$site"
{
  tools/certificates.sh init "$work/authority"
  tools/certificates.sh server "$work/authority" localhost 127.0.0.1
  tools/certificates.sh client "$work/authority" inspector anna
} >>"$log" 2>&1
mkdir "$site/tls"
cp "$work/authority"/{ca.pem,crl.pem,localhost.pem,localhost.key} "$site/tls"
chown -R 0:7443 "$site/tls"
chmod 0640 "$site/tls"/*
chmod 0755 "$work" "$site" "$site/tls"
cat >"$site/shiftmap.toml" <<'END'
store = "/var/lib/shiftmap/maps.db"

[shiftmap-server]
listen = "127.0.0.1:0"
tls-cert = "/etc/shiftmap/tls/localhost.pem"
tls-key = "/etc/shiftmap/tls/localhost.key"
client-ca = "/etc/shiftmap/tls/ca.pem"
crl = "/etc/shiftmap/tls/crl.pem"

[nightly]
logs = "/var/lib/shiftmap/logs"
min-age-s = 0
END
mkdir "$work/drives"
cp "$world/run_000.mcap" "$world/run_001.mcap" "$work/drives"
chmod -R a+rX "$work/drives"
# The image's own volume has the maps, for as long as the container is there.
run() { image run --volume "$work/drives:/drives:ro" --volume "$site:/etc/shiftmap:ro" "$container" -- "$@"; }

[[ $(run id --user) == 7443 ]] || fail "the image's user is not 7443"
run cp -r /drives /var/lib/shiftmap/logs || fail "the image's user cannot write where the maps are"
run shiftmap-mapper nightly --area floor --quiet >"$work/night.log" 2>&1 || fail "the first night fails"

# As a runtime starts it, but for the port of the metrics, which may be taken here.
mapfile -t entry < <(image inspect --type image shiftmap | python3 -c '
import json, sys
config = json.load(sys.stdin)["OCIv1"]["config"]
print("\n".join(config["Entrypoint"] + config["Cmd"]))')
run "${entry[@]/0.0.0.0:9464/127.0.0.1:0}" >"$work/out.log" 2>"$work/server.log" &
server=$!
for _ in $(seq 200); do
  address=$(sed -n 's/.*"event":"listening".*"address":"\([^"]*\)".*/\1/p' "$work/server.log")
  [[ -z $address ]] || break
  kill -0 "$server" 2>/dev/null || break
  sleep 0.1
done
[[ -n $address ]] || fail "the server does not listen"

# The health service's answer SERVING: field 1 is 1.
/usr/bin/python3 - "$address" "$work/authority" <<'END' >>"$log" 2>&1 || fail "the server does not say that it is healthy: $log"
import sys

import grpc

address, authority = sys.argv[1:]
read = [open(f"{authority}/{name}", "rb").read() for name in ("ca.pem", "anna.key", "anna.pem")]
with grpc.secure_channel(address, grpc.ssl_channel_credentials(*read)) as channel:
    answer = channel.unary_unary("/grpc.health.v1.Health/Check")(b"", timeout=30)
assert answer == b"\x08\x01", answer
END

# The nightly job beside it: the logs are mapped already.
code=0
run shiftmap-mapper nightly --quiet >"$work/night.log" 2>&1 || code=$?
[[ $code == 5 ]] || fail "a night beside the server ends with $code"

stop_server
wait "$server" || fail "the server ends with $?"
server=
echo "packages: the image is built, its server is healthy and its nightly job runs"

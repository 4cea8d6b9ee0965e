#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# A site's day and night with the programs as units run them: a server with certificates, two
# vehicles with serve and sync, three shifts, nights between them, and a rollback in the morning.
# Usage: site_test.sh BINARY_DIR SOURCE_DIR
set -euo pipefail

PATH=$(realpath "$1"):$PATH
source=$(realpath "$2")
site=$(mktemp --directory)
pids=()
cleanup() {
  ((${#pids[@]} == 0)) || kill "${pids[@]}" 2>/dev/null || true
  wait || true
  rm -rf "$site"
}
trap cleanup EXIT
cd "$site"
export SHIFTMAP_CONFIG=$site/shiftmap.toml

fail() {
  echo "site: $*"
  tail -n 20 ./*.log
  exit 1
}
# json <expression of d>: of a JSON document on standard input.
json() { python3 -c "import json, sys; d = json.load(sys.stdin); print($1)"; }
expect() { [[ $2 == "$3" ]] || fail "$1: $2, expected $3"; }

printf 'store = "%s/maps.db"\narea = "floor"\n[nightly]\nlogs = "%s/logs"\nmin-age-s = 0\n' "$site" "$site" >shiftmap.toml
shiftmap-sim open world --shifts 5 --vehicles 2 --groups 10 --modes 2 --size-m 30 --duration-s 120 --seed 11 \
  --quiet >/dev/null

# The area begins with the logs of two survey drives.
mkdir -p logs/survey
cp world/run_000.mcap world/run_001.mcap logs/survey
shiftmap-mapper nightly --area floor --quiet >/dev/null || fail "the first night"
published() { shiftmap-inspect versions --json | json '[v["version"] for v in d["versions"] if v["published"]][0]'; }
expect "after the first night" "$(published)" 1

tls=$source/tools/certificates.sh
"$tls" init tls >/dev/null
"$tls" server tls localhost 127.0.0.1 >/dev/null
shiftmap-server --listen 127.0.0.1:0 --tls-cert tls/localhost.pem --tls-key tls/localhost.key --client-ca tls/ca.pem \
  --crl tls/crl.pem --snapshots snapshots --logs logs --poll-s 0.1 --snapshot-interval-s 1 2>server.log >/dev/null &
pids+=($!)
for _ in $(seq 100); do
  address=$(sed -n 's/.*"event":"listening".*"address":"\([^"]*\)".*/\1/p' server.log)
  [[ -z $address ]] || break
  sleep 0.1
done
[[ -n $address ]] || fail "the server does not listen"

# sync <vehicle>: one round; what is there already is no failure.
sync() {
  local code=0
  shiftmap-localizer sync --once --server "$address" --tls-ca tls/ca.pem --tls-cert "tls/$1.pem" --tls-key "tls/$1.key" \
    --state-dir "$1/state" --outbox "$1/outbox" --maps "$1/maps" --socket "$1/socket" --map-source server \
    >>"$1.log" 2>&1 || code=$?
  ((code == 0 || code == 5)) || fail "sync of $1 ends with $code"
}
ctl() { shiftmap-localizer ctl --socket "$1/socket" "${@:2}"; }
version_of() { ctl "$1" state --json | json 'd["version"]'; }

for vehicle in truck-1 truck-2; do
  "$tls" client tls vehicle "$vehicle" >/dev/null
  mkdir -p "$vehicle/maps" "$vehicle/state"
  sync "$vehicle"
  shiftmap-localizer serve --maps "$vehicle/maps" --map-source server --socket "$vehicle/socket" --vehicle "$vehicle" \
    --state-dir "$vehicle/state" 2>>"$vehicle.log" &
  pids+=($!)
  for _ in $(seq 100); do [[ ! -S $vehicle/socket ]] || break; sleep 0.1; done
  expect "the map of $vehicle" "$(version_of "$vehicle")" 1
done

# shift <vehicle> <run>: drives it, ends it, and hands in what it left.
shift_of() {
  local vehicle=$1
  ctl "$vehicle" start >/dev/null
  ctl "$vehicle" feed "world/run_$2.mcap" >/dev/null || fail "the shift of $vehicle"
  expect "the state of $vehicle" "$(ctl "$vehicle" state --json | json 'd["state"] in ("TRACKING", "MODE_CHANGED", "UNKNOWN_CHANGE")')" True
  ctl "$vehicle" stop >/dev/null
  # The log is written after the report, by a thread.
  for _ in $(seq 100); do compgen -G "$vehicle/state/*.mcap" >/dev/null && break; sleep 0.1; done
  sync "$vehicle"
  ! compgen -G "$vehicle/state/*.report" >/dev/null || fail "a report of $vehicle was not handed in"
}

night() {
  local code=0
  shiftmap-mapper nightly --json >"$1.json" 2>"$1.log" || code=$?
  expect "the exit code of $1" "$code" 0
}
wait_for_snapshot() {
  for _ in $(seq 100); do
    [[ $(json 'd["version"]' <"$(compgen -G 'snapshots/*.json')") != "$1" ]] || return 0
    sleep 0.1
  done
  fail "the server has no snapshot of version $1"
}

shift_of truck-1 002
shift_of truck-2 003
expect "reports" "$(shiftmap-inspect reports --json | json 'len(d["reports"])')" 2
night night-1
expect "after a day" "$(published)" 2
expect "runs of the first night" "$(json 'd["areas"][0]["runs_new"]' <night-1.json)" 2

wait_for_snapshot 2
for vehicle in truck-1 truck-2; do
  sync "$vehicle"
  expect "the map of $vehicle in the morning" "$(version_of "$vehicle")" 2
done
shift_of truck-1 004
night night-2
expect "after two days" "$(published)" 3

# A foreman does not like what he sees; vehicles have the map before again.
shiftmap-inspect rollback --quiet >/dev/null
expect "after the rollback" "$(published)" 2
wait_for_snapshot 2
sync truck-1
expect "the map of truck-1 after the rollback" "$(version_of truck-1)" 2

expect "reports in the end" "$(shiftmap-inspect reports --json | json 'len({r["uuid"] for r in d["reports"]}), len(d["reports"])')" "3 3"
expect "logs in the end" "$(find logs -name '*.mcap' | wc -l)" 5
# The next night does not undo what the foreman did, and says so.
code=0
shiftmap-mapper nightly --json >night-3.json 2>night-3.log || code=$?
expect "the exit code of a night after a rollback" "$code" 8
grep -q 'rolled back' night-3.log || fail "the night does not name the run"
expect "after the night" "$(published)" 2
shiftmap-inspect verify --quiet >/dev/null || fail "the store does not verify"
echo "site: three shifts, three nights and a rollback went through"

#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
#
# The recording of a shift, read by MCAP's reference implementation and held against the public
# schemas of Foxglove. Usage: recording_reference_test.sh BIN NODE_MODULES; exits 77, skipped, where
# node or a package is absent.
set -eu
bin=$1
modules=$2

command -v node >/dev/null || { echo "skipped: no node"; exit 77; }
for package in @foxglove/schemas @mcap/core protobufjs zstd-codec; do
  [ -d "$modules/$package" ] || { echo "skipped: no npm package $package in $modules"; exit 77; }
done
export SHIFTMAP_NODE_MODULES="$modules"

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"$bin/shiftmap-sim" open "$work" --shifts 3 --groups 15 --modes 2 --duration-s 120 --seed 7 \
  --quiet >/dev/null
"$bin/shiftmap-mapper" build --store "$work/maps.db" --area floor --quiet \
  "$work/run_000.mcap" "$work/run_001.mcap" >/dev/null
"$bin/shiftmap-localizer" run --store "$work/maps.db" --area floor --json \
  --recording "$work/shift.mcap" --trajectory "$work/shift.tum" "$work/run_002.mcap" >"$work/run.json"
node "$(dirname "$0")/recording_reference.mjs" \
  "$work/shift.mcap" "$work/shift.tum" "$work/run.json"

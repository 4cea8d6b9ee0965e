#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The whole loop on simulated shifts: vehicles drive, the mapper builds a map at night, a vehicle
# localizes on it the next day and returns what it learned, over a map server too, and a picture
# shows the result.
# Usage: tools/demo.sh [OUTPUT_DIR]
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

out=${1:-build/demo}

tools/setup.sh
cmake --preset release >/dev/null
# Experiments and converters are not shown here, and are a fifth of the build.
cmake --build --preset release --target shiftmap-sim shiftmap-mapper shiftmap-localizer shiftmap-transfer \
  shiftmap-server shiftmap-inspect shiftmap-eval
bin=$PWD/build/release/bin

rm -rf "$out"
mkdir -p "$out/trajectories"

echo
echo "== Five shifts on a floor where one landmark in four moves between shifts"
"$bin/shiftmap-sim" open "$out/world" --shifts 5 --groups 20 --modes 2 --size-m 30 \
  --mode-change-probability 0.25 --odometry-scale-v 0.95 --odometry-lag-s 0.1 --seed 7

echo
echo "== The mapper builds a map of the first four"
"$bin/shiftmap-mapper" build --store "$out/maps.db" --area floor \
  --trajectories "$out/trajectories" "$out"/world/run_00[0-3].mcap

echo
echo "== On the fifth, a vehicle localizes on that map and returns what it learned"
"$bin/shiftmap-localizer" run --store "$out/maps.db" --area floor --initial-pose auto \
  --trajectory "$out/run_004.tum" --report "$out/run_004.report" --return \
  "$out/world/run_004.mcap"

echo
echo "== The map, with the probabilities that follow"
# At the end of the fifth shift: by now the simulated landmarks could stand anywhere.
at=1767945900
"$bin/shiftmap-inspect" show --store "$out/maps.db" --area floor --at "$at" | head -n 20

echo
echo "== How far that is from the truth: the trajectory, and where the landmarks stood on that shift"
"$bin/shiftmap-eval" trajectory "$out/run_004.tum" "$out/world/run_004.truth.tum" --align
"$bin/shiftmap-eval" map --store "$out/maps.db" --area floor "$out/world/run_004.places.csv" | tail -n 1

echo
echo "== Over a network: the vehicle hands in its log, a night maps it, and the vehicle gets the new map"
"$bin/shiftmap-server" --store "$out/maps.db" --logs "$out/logs" --listen 127.0.0.1:0 --development-plain-text --poll-s 0.1 \
  2>"$out/server.log" >/dev/null &
trap 'kill %1' EXIT
until address=$(grep -o '127.0.0.1:[0-9]*' "$out/server.log"); do kill -0 %1 && sleep 0.1; done
server=(--server "$address" --development-plain-text)
"$bin/shiftmap-localizer" fetch "${server[@]}" --area floor --output "$out/vehicle.db"
"$bin/shiftmap-localizer" upload "${server[@]}" "$out/world/run_004.mcap"
"$bin/shiftmap-mapper" nightly --store "$out/maps.db" --logs "$out/logs" --area floor --min-age-s 0 --report "$out/nights"
until "$bin/shiftmap-localizer" fetch "${server[@]}" --area floor --output "$out/vehicle.db"; do sleep 0.2; done

echo
echo "== The picture"
for ending in svg png; do
  "$bin/shiftmap-inspect" plot map --store "$out/maps.db" --area floor --at "$at" \
    --output "$out/map.$ending"
done

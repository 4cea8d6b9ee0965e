#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Every command that only inspects, on a file system that is mounted read-only: each answers, and
# writes nothing, as one that tried would fail. Ends with 77 where nothing can be mounted.
# Usage: read_only_test.sh BINARY_DIR
set -euo pipefail

bin=$(realpath "$1")
if [[ -z ${INSIDE:-} ]]; then
  # The mount goes with its namespace.
  unshare --map-root-user --mount bash -c 'mount -t tmpfs none /mnt && mount -o remount,ro none /mnt' 2>/dev/null ||
    { echo "skipped: nothing can be mounted here"; exit 77; }
  INSIDE=1 exec unshare --map-root-user --mount "${BASH_SOURCE[0]}" "$bin"
fi

PATH=$bin:$PATH
folder=$(mktemp --directory)
trap 'umount "$folder" && rmdir "$folder"' EXIT
mount -t tmpfs none "$folder"
cd "$folder"
shiftmap-sim open world --shifts 2 --groups 6 --modes 2 --size-m 20 --seed 5 --quiet >/dev/null
shiftmap-mapper build --quiet --store maps.db --area floor world/run_000.mcap >/dev/null
shiftmap-localizer run --quiet --store maps.db --area floor --return world/run_001.mcap >/dev/null
shiftmap-mapper build --quiet --store maps.db --area floor world/run_001.mcap >/dev/null
shiftmap-inspect export --quiet --snapshot --store maps.db --area floor --output floor.snapshot >/dev/null
signature=$(shiftmap-inspect modes --store maps.db --area floor --json | grep -o '"signature": *"[^"]*"' | head -n 1 | cut -d '"' -f 4)
mount -o remount,ro none "$folder"
if touch probe 2>/dev/null; then echo "the mount can be written to"; exit 1; fi

floor=(--area floor)
count=0
for store in maps.db floor.snapshot; do
  while IFS= read -r line; do
    read -ra words <<<"$line"
    shiftmap-inspect "${words[@]}" --store "$store" >/dev/null || { echo "exit $? of: $line --store $store"; exit 1; }
    count=$((count + 1))
  done <<END
areas
verify
audit
versions ${floor[*]}
show ${floor[*]}
vehicles ${floor[*]}
modes ${floor[*]}
modes $signature ${floor[*]}
history $signature ${floor[*]}
sightings ${floor[*]}
runs ${floor[*]} --all
reports ${floor[*]}
edit list ${floor[*]}
plot map ${floor[*]} --output /dev/null.svg --dry-run
export ${floor[*]} --csv --output /dev/null.csv --dry-run
END
done
shiftmap-inspect diff 1 2 "${floor[@]}" --store maps.db >/dev/null
cd /
echo "$count commands"

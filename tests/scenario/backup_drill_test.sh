#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Runs the commands of the operations guide's section Backup on a site's store, while a writer is at
# work: what is restored shows the same map as the store did.
# Usage: backup_drill_test.sh DOCUMENT BINARY_DIR
set -euo pipefail

document=$(realpath "$1")
PATH=$(realpath "$2"):$PATH
folder=$(mktemp --directory)
trap 'rm -rf "$folder"' EXIT
cd "$folder"

shiftmap-sim open world --shifts 2 --groups 6 --modes 2 --size-m 20 --seed 5 --quiet >/dev/null
shiftmap-mapper build --quiet --store maps.db --area floor world/run_000.mcap world/run_001.mcap >/dev/null
shown=(shiftmap-inspect show --area floor --version 1 --at 2026-06-01 --json)
"${shown[@]}" --store maps.db >before.json

count=0
while IFS= read -r line; do
  echo "\$ $line"
  shiftmap-mapper build --quiet --no-publish --store maps.db --area other world/run_000.mcap >/dev/null &
  bash -c "$line" || {
    echo "exit $? of: $line"
    exit 1
  }
  wait
  count=$((count + 1))
done < <(sed -n '/^## Backup/,/^## Upgrade/s/^    \(shiftmap-.*\)$/\1/p' "$document")

((count == 4)) || { echo "$count commands in $document, expected 4"; exit 1; }
"${shown[@]}" --store restored.db | cmp - before.json || { echo "the restored map differs"; exit 1; }

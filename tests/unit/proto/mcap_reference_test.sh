#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
#
# Both ways against MCAP's reference implementation: it reads our files, and we read its files, which
# have an index. Every number must come out bit by bit.
# Usage: mcap_reference_test.sh TOOL NODE_MODULES; exits 77, skipped, where node or a package is
# absent.
set -eu
tool=$1
modules=$2
script=$(dirname "$0")/mcap_reference.mjs

command -v node >/dev/null || { echo "skipped: no node"; exit 77; }
for package in @mcap/core protobufjs zstd-codec; do
  [ -d "$modules/$package" ] || { echo "skipped: no npm package $package in $modules"; exit 77; }
done
export SHIFTMAP_NODE_MODULES="$modules"

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

for compression in zstd none; do
  ours=$work/ours_$compression.mcap
  "$tool" write "$ours" $compression
  "$tool" print "$ours" >"$work/expected"
  node "$script" print "$ours" >"$work/actual"
  cmp "$work/expected" "$work/actual"
  node "$script" summary "$ours"
  for kind in zstd none unchunked; do
    theirs=$work/theirs_$kind.mcap
    node "$script" rewrite "$ours" "$theirs" $kind
    "$tool" print "$theirs" >"$work/actual"
    cmp "$work/expected" "$work/actual"
    "$tool" print - <"$theirs" | cmp "$work/expected" -
  done
done
echo "$(wc -l <"$work/expected") items agree"

#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Runs clang-tidy over the sources of a configured build (default build/dev), or over the files named.
# Usage: tools/tidy.sh [FILE.cc...]
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

build=${SHIFTMAP_BUILD:-build/dev}
files=("$@")
if ((${#files[@]} == 0)); then
  mapfile -t files < <(git ls-files 'proto/*.cc' 'mapstore/*.cc' 'localizer/*.cc' 'mapper/*.cc' 'tools/*.cc')
fi
printf '%s\n' "${files[@]}" |
  xargs --max-args=1 --max-procs="$(nproc)" clang-tidy --quiet -p "$build"

#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Runs clang-tidy over all sources but tests, or over the files named.
# Usage: tools/tidy.sh [FILE.cc...]
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

# clang reads no precompiled header of another compiler, and wants the flags of each file.
cmake --preset dev -B build/tidy -DCMAKE_DISABLE_PRECOMPILE_HEADERS=ON -DCMAKE_UNITY_BUILD=OFF >/dev/null
cmake --build build/tidy --target shiftmap_messages shiftmap_map_service >/dev/null

files=("$@")
if ((${#files[@]} == 0)); then
  mapfile -t files < <(git ls-files 'proto/*.cc' 'mapstore/*.cc' 'localizer/*.cc' 'mapper/*.cc' 'tools/*.cc')
fi
printf '%s\n' "${files[@]}" |
  xargs --max-args=1 --max-procs="$(nproc)" clang-tidy --quiet -p build/tidy

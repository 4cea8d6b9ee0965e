#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Runs tests and fuzz targets under sanitizers; a finding makes it fail.
# Usage: tools/sanitize.sh asan            all tests, address and undefined-behaviour sanitizers
#        tools/sanitize.sh tsan            the tests that run threads, thread sanitizer
#        tools/sanitize.sh fuzz [MINUTES [TARGET...]]   libFuzzer targets, each for MINUTES (10) of
#                                          processor time; corpora and findings stay in build/fuzz.
#                                          Of a target with parts one is TARGET.PART
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

# The tests that run threads, in themselves or in the commands that they call.
threaded=(shiftmap_{mcap,codec,store,live,mapper,selector_build,selection,chain,experiment,serve,nightly,nightly_builds}_test)

export UBSAN_OPTIONS=print_stacktrace=1
export LSAN_OPTIONS=suppressions=$PWD/tests/fuzz/lsan.supp:print_suppressions=0
export TSAN_OPTIONS=halt_on_error=1:second_deadlock_stack=1

build() {
  cmake --preset "$1" >/dev/null
  cmake --build --preset "$1" "${@:2}"
}

# fuzz_target <seconds> <target>: runs one until it has used the processor for so long, or found
# something. libFuzzer itself counts the time on the wall. Memory is of the last round: when its
# inputs were read, and at the end. What the sanitizer keeps of freed memory, 256 MiB otherwise,
# would hide whether the program's own memory grows.
fuzz_target() {
  local left_ms=$((1000 * $1)) target=$2 runs=0 user system memory
  if [[ $target == *.* ]]; then export SHIFTMAP_FUZZ_PART=${target#*.}; fi
  export ASAN_OPTIONS=quarantine_size_mb=16
  local corpus=build/fuzz/corpus/$target log=build/fuzz/$target.log
  local TIMEFORMAT='%3U %3S'
  mkdir -p "$corpus" build/fuzz/findings
  while ((left_ms > 0)); do
    if ! { time "build/fuzz/tests/fuzz/${target%%.*}" "$corpus" -max_len=4096 -rss_limit_mb=2048 \
      -timeout=20 -max_total_time=$((left_ms / 1000 + 1)) -print_final_stats=1 \
      -artifact_prefix="build/fuzz/findings/$target-" >"$log" 2>&1; } 2>"$log.time"; then
      echo "FAILED: $target, see $log"
      return 1
    fi
    read -r user system <"$log.time"
    left_ms=$((left_ms - 10#${user/./} - 10#${system/./}))
    runs=$((runs + $(sed -n 's/stat::number_of_executed_units: *//p' "$log")))
  done
  memory=$(sed -n 's/.*\bINITED\b.* rss: *\([0-9]*\)Mb.*/\1/p; s/stat::peak_rss_mb: */to /p' "$log" | tr '\n' ' ')
  echo "ok: $target, $1 s, $runs runs, ${memory}MiB"
}

case ${1:-} in
  asan)
    tools/setup.sh
    build asan
    tools/mcap_packages.sh build/asan
    ctest --preset asan --label-exclude bench
    ;;
  tsan)
    tools/setup.sh
    build tsan --target "${threaded[@]}"
    ctest --preset tsan --tests-regex "^($(IFS='|' && echo "${threaded[*]}"))\$"
    ;;
  fuzz)
    tools/setup.sh fuzz
    seconds=$((60 * ${2:-10}))
    targets=("${@:3}")
    if ((${#targets[@]} == 0)); then
      cmake --preset fuzz >/dev/null
      mapfile -t targets < <(ctest --test-dir build/fuzz --label-regex fuzz --show-only |
        sed -n 's/.*Test *#[0-9]*: //p')
    fi
    mapfile -t binaries < <(printf '%s\n' "${targets[@]%%.*}" | sort --unique)
    build fuzz --target "${binaries[@]}"
    export -f fuzz_target
    printf '%s\n' "${targets[@]}" |
      xargs --max-procs="$(nproc)" -I{} bash -c 'fuzz_target "$@"' fuzz "$seconds" {}
    ;;
  *)
    sed -n '/^# Usage/,/^[^#]/ s/^# \{0,1\}//p' "$0" >&2
    exit 2
    ;;
esac

#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Runs what there is under sanitizers; a finding makes the exit code 1.
# Usage: tools/sanitize.sh asan            all tests, address and undefined-behaviour sanitizers
#        tools/sanitize.sh tsan            the tests that run threads, thread sanitizer
#        tools/sanitize.sh fuzz [MINUTES [TARGET...]]   libFuzzer targets, each for MINUTES (10) of
#                                          processor time; corpora and findings stay in build/fuzz
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

# The tests that run threads, in themselves or in the commands that they call.
threaded='shiftmap_(mcap|codec|store|live|mapper|selector_build|selection|chain|experiment|serve|nightly_builds)_test'

export UBSAN_OPTIONS=print_stacktrace=1
export TSAN_OPTIONS=halt_on_error=1:second_deadlock_stack=1

build() {
  cmake --preset "$1" >/dev/null
  cmake --build --preset "$1" "${@:2}"
}

# fuzz_target <seconds> <target>: runs one until it has used the time or found something.
fuzz_target() {
  local seconds=$1 target=$2 spent=0 user system
  local folder=build/fuzz/corpus/$target log=build/fuzz/$target.log
  mkdir -p "$folder" build/fuzz/findings
  : >"$log"
  while ((spent < seconds)); do
    local ok=1
    TIMEFORMAT='%0U %0S'
    read -r user system < <({
      time "build/fuzz/tests/fuzz/$target" "$folder" -max_total_time=$((seconds - spent + 1)) \
        -artifact_prefix="build/fuzz/findings/$target-" -max_len=4096 -rss_limit_mb=2048 \
        -timeout=20 -print_final_stats=1 >>"$log" 2>&1 || echo failed >>"$log"
    } 2>&1)
    spent=$((spent + user + system + 1))
    [[ $(tail -n 1 "$log") != failed ]] || ok=0
    if ((!ok)); then
      echo "FAILED: $target after $spent s, see $log"
      return 1
    fi
  done
  local runs
  runs=$(awk '/number_of_executed_units/ {sum += $2} END {print sum + 0}' "$log")
  echo "ok: $target, $spent s, $runs runs"
}

case ${1:-} in
  asan)
    tools/setup.sh
    build asan
    ctest --preset asan --label-exclude bench
    ;;
  tsan)
    tools/setup.sh
    build tsan
    ctest --preset tsan --tests-regex "$threaded"
    ;;
  fuzz)
    tools/setup.sh fuzz
    build fuzz --target shiftmap_fuzz
    seconds=$((60 * ${2:-10}))
    targets=("${@:3}")
    ((${#targets[@]} > 0)) ||
      mapfile -t targets < <(ctest --test-dir build/fuzz --label-regex fuzz --show-only |
        sed -n 's/.*Test *#[0-9]*: //p')
    export -f fuzz_target
    printf '%s\n' "${targets[@]}" |
      xargs --max-procs="$(nproc)" -I{} bash -c 'fuzz_target "$@"' fuzz "$seconds" {}
    ;;
  *)
    sed -n '/^# Usage/,/^[^#]/ s/^# \{0,1\}//p' "$0" >&2
    exit 2
    ;;
esac

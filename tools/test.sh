#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Builds everything anew with warnings as errors and runs every check there is. The last line counts
# them; the exit code is 0 only if tests ran and none failed.
# shellcheck disable=SC2317  # Functions are run by check().
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

tools/setup.sh

if [[ -z ${SHIFTMAP_DATA:-} && -d ../shared/data ]]; then
  SHIFTMAP_DATA=$(realpath ../shared/data)
fi
[[ -z ${SHIFTMAP_DATA:-} ]] || export SHIFTMAP_DATA
export CTEST_PARALLEL_LEVEL=${CTEST_PARALLEL_LEVEL:-$(nproc)}

passed=0
failed=0
skipped=0

# check <name> <command...>: one check beside the tests; it counts as one test.
check() {
  local name=$1
  shift
  if "$@"; then
    echo "ok: $name"
    passed=$((passed + 1))
  else
    echo "FAILED: $name"
    failed=$((failed + 1))
  fi
}

# run_tests <preset> [ctest option...]: runs tests and counts their cases.
run_tests() {
  local tests="0 0 0" tests_passed tests_failed tests_skipped
  rm -rf build/gtest build/ctest.xml
  GTEST_OUTPUT=xml:$PWD/build/gtest/ \
    ctest --preset "$@" --output-junit "$PWD/build/ctest.xml" || true
  [[ ! -s build/ctest.xml ]] || tests=$(tools/count_tests.py build/ctest.xml build/gtest)
  read -r tests_passed tests_failed tests_skipped <<<"$tests"
  if ((tests_passed + tests_failed == 0)); then
    echo "FAILED: no test ran"
    tests_failed=1
  fi
  passed=$((passed + tests_passed))
  failed=$((failed + tests_failed))
  skipped=$((skipped + tests_skipped))
}

finish() {
  echo "$passed passed, $failed failed, $skipped skipped"
  if ((failed > 0 || passed == 0)); then exit 1; fi
  exit 0
}

formatted() {
  git ls-files --cached --others --exclude-standard '*.h' '*.cc' |
    xargs --no-run-if-empty clang-format --dry-run --Werror
}

# Installs into a scratch folder and builds programs that only know find_package(shiftmap).
consumer() {
  rm -rf build/install build/consumer &&
    cmake --install build/dev --prefix "$PWD/build/install" >build/install.log &&
    cmake -S tests/consumer -B build/consumer -G Ninja \
      -DCMAKE_PREFIX_PATH="$PWD/build/install" >build/consumer.log &&
    cmake --build build/consumer &&
    build/consumer/consumer &&
    build/consumer/write_log build/consumer/run.mcap &&
    build/install/bin/shiftmap-convert check build/consumer/run.mcap
}

# Of what comes from outside; all else under sanitizers takes longer (tools/sanitize.sh).
sanitized_readers() {
  cmake --preset asan >/dev/null && cmake --build --preset asan --target shiftmap_reader_targets
}

# A compiler that runs out of disk does so late, and its message is not the last.
disk_space() {
  local needed=2000 free
  free=$(df --output=avail --block-size=MB . | tail -n 1 | tr -dc '0-9')
  ((free >= needed)) || {
    echo "the build needs $needed MB of disk, $free MB are free"
    return 1
  }
}

rm -rf build/dev
check "disk space" disk_space
((failed == 0)) || finish
# Several files at once compile in less time; a developer's build compiles only what changed.
check "configure" cmake --preset dev -DCMAKE_UNITY_BUILD=ON
((failed == 0)) || finish
check "build without warnings" cmake --build --preset dev
((failed == 0)) || finish

# The reference implementation of MCAP; without it its test says that it is skipped.
tools/mcap_packages.sh build/dev

run_tests dev

check "build the fuzz targets of readers under sanitizers" sanitized_readers
run_tests asan --label-regex reader

check "headers compile alone" cmake --build --preset dev --target all_verify_interface_header_sets
check "API documentation without warnings" cmake --build --preset dev --target api_docs
check "format" formatted
check "install and find_package" consumer
check "packages in a clean Debian" tools/packaging/test_packages.sh build/dev
finish

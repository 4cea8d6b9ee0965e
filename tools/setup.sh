#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Installs what shiftmap is built, tested and demonstrated with, on Debian 12. Does nothing, and
# needs no network, where everything is there. Usage: tools/setup.sh [fuzz], then also for fuzzers.
set -euo pipefail

packages=(
  # Build
  cmake g++ git ninja-build pkg-config protobuf-compiler protobuf-compiler-grpc
  # Libraries
  libabsl-dev libboost-dev libcairo2-dev libceres-dev libcli11-dev libcurl4-openssl-dev libeigen3-dev libfastcdr-dev
  libfmt-dev libgrpc++-dev liblz4-dev
  libmetis-dev libmicrohttpd-dev libpng-dev libprotobuf-dev librsvg2-dev libspdlog-dev libsqlite3-dev libssl-dev
  libtomlplusplus-dev libyaml-cpp-dev libzstd-dev
  nlohmann-json3-dev uuid-dev zlib1g-dev
  # Tests and checks
  chromium clang-format curl doxygen libbenchmark-dev libgmock-dev libgtest-dev mosquitto munge nginx-light openssl
  python3 python3-grpcio python3-jsonschema python3-paho-mqtt slurm-wlm zsh
  # Packages
  buildah debhelper dh-python fakeroot help2man lintian mmdebstrap systemd-container
  # Python package
  pybind11-dev python3-dev python3-numpy
)
[[ ${1:-} != fuzz ]] || packages+=(clang libclang-rt-14-dev)

missing=()
for package in "${packages[@]}"; do
  status=$(dpkg-query --show --showformat='${Status}' "$package" 2>/dev/null || true)
  [[ $status == "install ok installed" ]] || missing+=("$package")
done

# The packages of Node.js that others than Debian make bring npm along and exclude Debian's.
command -v npm >/dev/null || missing+=(nodejs npm)

if ((${#missing[@]} == 0)); then
  echo "setup: everything is installed"
  exit 0
fi

as_root=()
((EUID == 0)) || as_root=(sudo)
echo "setup: installing ${missing[*]}"
"${as_root[@]}" apt-get update -qq
"${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
  apt-get install -y -qq --no-install-recommends "${missing[@]}"

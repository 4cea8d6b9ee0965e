#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Installs the npm packages of the tests against references into a build folder.
# Usage: tools/mcap_packages.sh BUILD_DIR
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
mkdir -p "$1/npm"
cp tests/unit/proto/package.json "$1/npm/"
npm install --prefix "$1/npm" --no-audit --no-fund --silent ||
  echo "warning: the npm packages of the tests against references could not be installed"

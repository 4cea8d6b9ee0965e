#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Runs the commands of a document, the lines indented by four spaces, one after the other in a
# folder of its own. Each must end with 0.
# Usage: tutorial_test.sh DOCUMENT BINARY_DIR
set -euo pipefail

document=$(realpath "$1")
PATH=$(realpath "$2"):$PATH
folder=$(mktemp --directory)
trap 'rm -rf "$folder"' EXIT
cd "$folder"

count=0
while IFS= read -r line; do
  echo "\$ $line"
  bash -c "$line" >out 2>err || {
    echo "exit $? of: $line"
    cat out err
    exit 1
  }
  count=$((count + 1))
done < <(sed -n 's/^    \(shiftmap-.*\)$/\1/p' "$document")

((count > 0)) || { echo "no command in $document"; exit 1; }
echo "$count commands"

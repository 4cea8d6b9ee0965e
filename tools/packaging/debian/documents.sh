#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Prints the files of shiftmap-doc: documents, results, and what documents link, but for the places in
# the code that papers.md names.
set -e
folders="README.md proto mapstore localizer mapper tools tests"
{
  # shellcheck disable=SC2086  # Several words.
  find $folders -name '*.md' -o -name 'example_*.svg'
  find tests/results -type f
  # shellcheck disable=SC2086
  grep -roE '\]\([^)#:]+' --include='*.md' --exclude=papers.md $folders | while IFS=: read -r document link; do
    file=$(realpath --canonicalize-missing --relative-to=. "$(dirname "$document")/${link#](}")
    [ ! -f "$file" ] || echo "$file"
  done
} | sort -u

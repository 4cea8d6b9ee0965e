#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Makes manual pages and completions of installed programs from what the programs say of themselves.
# Usage: man_and_completion.sh BIN_DIR SHARE_DIR
set -euo pipefail
bin=$1
share=$2
man=$share/man/man1
mkdir -p "$man" "$share/bash-completion/completions" "$share/zsh/vendor-completions"

# page <name> <command...>: the first line of the help is what the command does.
page() {
  local name=$1 summary
  shift
  summary=$("$@" --help | sed -n 1p)  # Not head, which ends before the program has written all.
  help2man --no-info --section=1 --name="${summary,}" --version-string="$version" "$*" |
    sed -E "s#^\.TH .* \"1\"#.TH ${name^^} \"1\"#; s#$bin/##g; s#^$(basename "$1") ([a-z0-9-]+) \\\\- #$name \\\\- #" >"$man/$name.1"
}

for path in "$bin"/*; do
  program=$(basename "$path")
  version=$("$path" --version | awk '{print $NF}')
  page "$program" "$path"
  "$path" --help | sed -n '/^Subcommands:/,/^$/s/^  \([a-z0-9-]*\)  .*/\1/p' |
    while read -r command; do page "$program-$command" "$path" "$command"; done
  "$path" --completion bash >"$share/bash-completion/completions/$program"
  "$path" --completion zsh >"$share/zsh/vendor-completions/_$program"
done

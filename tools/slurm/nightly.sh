#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# A night over many areas as a Slurm job array: one task maps one area.
# Usage: tools/slurm/nightly.sh STORE LOGS SHARED [OPTION OF shiftmap-mapper nightly]...
#
# Runs where the store is, on a local disk. SHARED is a folder that all nodes have by the same path,
# and so are the logs; only plain files are put there. SHIFTMAP_MAPPER is the program, SBATCH_… what
# sbatch knows, e.g. SBATCH_PARTITION. Started again, it plans anew from what the store has.
# Exit code: that of collect.
set -euo pipefail

store=$1 logs=$2 shared=$3
shift 3
mapper=${SHIFTMAP_MAPPER:-shiftmap-mapper}
plan=$(realpath "$shared")/night.json

areas=$("$mapper" nightly plan --store "$store" --logs "$logs" --output "$plan" "$@" |
  sed -n '1s/ areas$//p')
echo "night: $areas areas"

if ((areas > 0)); then
  task=$(printf '%q ' "$mapper" nightly run --plan "$plan" "$@")
  # What a task did not do is named by collect, so that it keeps none of the others.
  sbatch --wait --quiet --job-name=shiftmap-night --array="0-$((areas - 1))" \
    --output="$plan.%a.log" --wrap="exec $task --index \$SLURM_ARRAY_TASK_ID" ||
    echo "night: a task did not end well, see $plan.*.log"
fi
exec "$mapper" nightly collect --plan "$plan" "$@"

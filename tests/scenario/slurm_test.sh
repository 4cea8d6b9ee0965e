#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Two tasks of a Slurm of one node map the areas of a fleet; the oracle is one process. Starts its
# own munge and Slurm in a folder; skipped (77) where that cannot be.
# Usage: slurm_test.sh SOURCE_DIR BINARY_DIR
set -euo pipefail

source_dir=$(realpath "$1")
bin=$(realpath "$2")
export PATH=$PATH:/usr/sbin
skip() { echo "skipped: $1"; exit 77; }
((EUID == 0)) || skip "Slurm starts as root only"
for program in munged slurmctld slurmd sbatch; do
  command -v "$program" >/dev/null || skip "no $program"
done

folder=$(mktemp --directory)
chmod 755 "$folder"
daemons=()
cleanup() {
  for pid in "${daemons[@]}"; do kill "$pid" 2>/dev/null || true; done
  wait 2>/dev/null || true
  rm -rf "$folder"
}
trap cleanup EXIT
cd "$folder"
mkdir -m 700 munge state spool
mkdir shared

head -c 128 /dev/urandom >munge/key
chmod 400 munge/key
munged --foreground --force --key-file="$folder/munge/key" --socket="$folder/munge.socket" \
  --pid-file="$folder/munge/pid" --log-file="$folder/munge/log" --seed-file="$folder/munge/seed" \
  >munge.out 2>&1 &
daemons+=($!)

host=$(hostname -s)
port=$((20000 + RANDOM % 20000))
cat >slurm.conf <<CONF
ClusterName=night
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=$port
SlurmdPort=$((port + 1))
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket=$folder/munge.socket
CredType=cred/munge
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerParameters=sched_interval=1
StateSaveLocation=$folder/state
SlurmdSpoolDir=$folder/spool
SlurmctldPidFile=$folder/slurmctld.pid
SlurmdPidFile=$folder/slurmd.pid
SlurmctldLogFile=$folder/slurmctld.log
SlurmdLogFile=$folder/slurmd.log
MailProg=/bin/true
ReturnToService=2
SlurmdParameters=config_overrides
NodeName=$host NodeAddr=127.0.0.1 CPUs=2 State=UNKNOWN
PartitionName=night Nodes=$host Default=YES MaxTime=INFINITE State=UP
CONF
export SLURM_CONF=$folder/slurm.conf
slurmctld -D -i >slurmctld.out 2>&1 &
daemons+=($!)
slurmd -D >slurmd.out 2>&1 &
daemons+=($!)
up=
for _ in $(seq 100); do
  if sinfo --noheader --format=%T 2>/dev/null | grep -q idle; then up=1; break; fi
  sleep 0.1
done
[[ $up ]] || { tail -n 5 munge.out slurmctld.out slurmd.out; skip "Slurm does not start here"; }

# Two areas, two nights.
for area in floor hall; do
  "$bin/shiftmap-sim" open "world-$area" --seed "$((1 + ${#area}))" --shifts 4 --vehicles 2 --groups 10 \
    --size-m 20 --duration-s 40 --shift-interval-s 14400 --quiet >/dev/null
done
mkdir logs
published() {
  for area in floor hall; do
    "$bin/shiftmap-inspect" versions --store "$1" --area "$area" --json |
      python3 -c 'import json, sys
print([v["content_hash"] for v in json.load(sys.stdin)["versions"] if v["published"]])'
  done
}
export SHIFTMAP_MAPPER=$bin/shiftmap-mapper
for night in 0 1; do
  for area in floor hall; do
    mkdir -p "logs/$area"
    for run in $((2 * night)) $((2 * night + 1)); do
      cp "world-$area/run_00$run.mcap" "logs/$area/"
    done
  done
  # The simulator's logs name no area: each area has its folder.
  if ((night == 0)); then
    for store in one.db many.db; do
      for area in floor hall; do
        "$SHIFTMAP_MAPPER" nightly --store $store --logs "logs/$area" --area "$area" \
          --min-age-s 0 --quiet >/dev/null
      done
    done
    continue
  fi
  "$SHIFTMAP_MAPPER" nightly --store one.db --logs logs --min-age-s 0
  "$source_dir/tools/slurm/nightly.sh" many.db logs shared --min-age-s 0
done
cat shared/night.json.*.log
[[ $(published many.db) == "$(published one.db)" ]] || { published many.db; published one.db; exit 1; }
published many.db
results=(shared/night.json.[0-9]*.db)
((${#results[@]} == 2)) || { echo "tasks that ended: ${#results[@]}"; exit 1; }

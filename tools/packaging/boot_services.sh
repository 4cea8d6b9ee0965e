#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Boots a Debian root that has the packages and a store with the area `floor`, and runs the services
# of a site and of a vehicle under their units: a snapshot goes from the server to the vehicle. Where
# a machine cannot boot a root, it says so and ends with 0. Needs root.
# Usage: tools/packaging/boot_services.sh ROOT LOG
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
root=$1 log=$2
services=(shiftmap-server shiftmap-localizer shiftmap-transfer)

skip() {
  echo "packages: the services are not run: $*"
  exit 0
}
fail() {
  in_boot journalctl --no-pager --boot >>"$log" 2>&1 || true
  echo "packages: $*" >&2
  exit 1
}

# until_true SECONDS COMMAND...
until_true() {
  local end=$((SECONDS + $1))
  until "${@:2}" >/dev/null 2>&1; do
    ((SECONDS < end)) || return 1
    sleep 0.2
  done
}
leader() { cut --delimiter=' ' --fields=1 "/proc/$nspawn/task/$nspawn/children"; }
in_boot() { timeout 300 nsenter --target "$(leader)" --all -- "$@"; }

[[ $EUID == 0 ]] || skip "that takes root"
command -v systemd-nspawn >/dev/null || skip "systemd-nspawn is not installed"

not_running() { ! kill -0 "$nspawn"; }

# One machine is server and vehicle, with certificates of its own authority.
tls=$root/etc/shiftmap/tls
authority=$(mktemp --directory)
dropin=$root/etc/systemd/system/shiftmap-transfer.service.d
nspawn=
clean() {
  if [[ -n $nspawn ]]; then
    kill -TERM "$nspawn" 2>/dev/null || true
    until_true 120 not_running || kill -KILL "$nspawn" 2>/dev/null || true
  fi
  rm -rf "$authority" "$tls" "$dropin" "$root/etc/shiftmap/localizer.env"
}
trap clean EXIT
{
  tools/certificates.sh init "$authority/a"
  tools/certificates.sh server "$authority/a" localhost 127.0.0.1
  tools/certificates.sh client "$authority/a" vehicle truck-7
} >>"$log" 2>&1
mkdir -p "$tls"
cp "$authority"/a/{ca.pem,crl.pem,localhost.pem,localhost.key} "$tls"
cp "$authority/a/truck-7.pem" "$tls/vehicle.pem"
cp "$authority/a/truck-7.key" "$tls/vehicle.key"
chroot "$root" chown -R root:shiftmap /etc/shiftmap/tls
chmod 0755 "$tls"
chmod 0640 "$tls"/*
chmod 0600 "$tls/vehicle.key"
chmod 0644 "$tls/ca.pem"
cat >>"$root/etc/shiftmap/shiftmap.toml" <<'END'
server = "127.0.0.1:7443"
area = "floor"
map-source = "server"
tls-ca = "/etc/shiftmap/tls/ca.pem"

[shiftmap-server]
listen = "127.0.0.1:7443"
tls-cert = "/etc/shiftmap/tls/localhost.pem"
tls-key = "/etc/shiftmap/tls/localhost.key"
client-ca = "/etc/shiftmap/tls/ca.pem"
crl = "/etc/shiftmap/tls/crl.pem"

[nightly]
logs = "/var/lib/shiftmap/logs"
END
printf 'SHIFTMAP_AREA=floor\nSHIFTMAP_VEHICLE=truck-7\n' >"$root/etc/shiftmap/localizer.env"

# On a machine whose processors all work, what runs only when they are idle would wait for ever.
mkdir -p "$dropin"
printf '[Service]\nCPUSchedulingPolicy=other\n' >"$dropin/test.conf"

# It needs neither a bus nor units of this machine, and no network but its own.
systemd-nspawn --quiet --boot --directory="$root" --register=no --keep-unit --private-network \
  --console=pipe </dev/null >>"$log" 2>&1 &
nspawn=$!
until_true 60 in_boot timeout 60 systemctl is-system-running --wait ||
  until_true 5 in_boot systemctl show --property=Version || skip "systemd-nspawn does not boot here: $log"

for service in "${services[@]}"; do
  in_boot systemctl start "$service" >>"$log" 2>&1 || fail "$service does not start: $log"
done
has_map() { in_boot sh -c 'ls /var/lib/shiftmap-maps/*.db'; }
until_true 120 has_map || fail "no snapshot comes to the vehicle: $log"
in_boot systemctl start shiftmap-nightly >>"$log" 2>&1 || fail "the night fails: $log"

# What is killed comes back.
server_pid() { in_boot systemctl show --property=MainPID --value shiftmap-server; }
before=$(server_pid)
in_boot systemctl kill --signal=KILL shiftmap-server
is_new() { [[ $(server_pid) != @(0|"$before") ]] && in_boot systemctl is-active shiftmap-server; }
until_true 30 is_new || fail "shiftmap-server is not started again: $log"

for service in "${services[@]}"; do
  in_boot systemctl is-active --quiet "$service" || fail "$service does not run: $log"
  in_boot systemctl stop "$service" || fail "$service does not stop: $log"
  result=$(in_boot systemctl show --property=Result --value "$service")
  [[ $result == success ]] || fail "$service ends with $result: $log"
done
echo "packages: the services start, work and stop under systemd"

#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# A vehicle's download from nginx, with the recipe as it is shipped but for names and places: the
# bytes have the hash that the area's file names, in pieces too, and only for clients of the site.
# Usage: mirror_test.sh BINARY_DIR SOURCE_DIR
set -euo pipefail

bin=$(realpath "$1")
source=$(realpath "$2")
folder=$(mktemp --directory)
pids=()
cleanup() {
  ((${#pids[@]} == 0)) || kill "${pids[@]}" 2>/dev/null || true
  wait || true
  rm -rf "$folder"
}
trap cleanup EXIT
cd "$folder"
fail() {
  echo "mirror: $*"
  cat ./*.log 2>/dev/null
  exit 1
}

"$source/tools/certificates.sh" init tls >/dev/null
"$source/tools/certificates.sh" server tls localhost 127.0.0.1 >/dev/null
"$source/tools/certificates.sh" client tls vehicle truck-7 >/dev/null
"$source/tools/certificates.sh" client tls vehicle truck-8 >/dev/null

"$bin/shiftmap-sim" open world --shifts 1 --groups 5 --modes 1 --size-m 20 --seed 3 --quiet >/dev/null
"$bin/shiftmap-mapper" build --quiet --store maps.db --area 'level 3' world/run_000.mcap >/dev/null
"$bin/shiftmap-server" --store maps.db --listen 127.0.0.1:0 --tls-cert tls/localhost.pem --tls-key tls/localhost.key \
  --client-ca tls/ca.pem --snapshots snapshots 2>server.log &
pids+=($!)
for _ in $(seq 100); do
  compgen -G 'snapshots/*.json' >/dev/null && break
  sleep 0.1
done
index=$(basename "$(compgen -G 'snapshots/*.json')") || fail "the server made no snapshot"

# A port that is free now; nginx takes no port 0.
port=$(python3 -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])')
{
  echo "pid $folder/nginx.pid; error_log $folder/nginx.log; daemon off; events {} http { access_log off;"
  for kind in client_body fastcgi proxy scgi uwsgi; do echo "${kind}_temp_path $folder/nginx-$kind;"; done
  sed -e "s#listen 8443#listen 127.0.0.1:$port#; s#/etc/shiftmap/tls/server#$folder/tls/localhost#" \
    -e "s#/etc/shiftmap/tls#$folder/tls#; s#/var/lib/shiftmap#$folder#" "$source/tools/packaging/nginx-snapshots.conf"
  echo "}"
} >nginx.conf
((EUID != 0)) || sed -i '1s/^/user root; /' nginx.conf
/usr/sbin/nginx -c "$folder/nginx.conf" 2>nginx.err.log &
pids+=($!)

url=https://127.0.0.1:$port
vehicle=(curl --silent --show-error --fail --cacert tls/ca.pem --cert tls/truck-7.pem --key tls/truck-7.key)
for _ in $(seq 100); do
  "${vehicle[@]}" --output newest.json "$url/$index" 2>/dev/null && break
  sleep 0.1
done
[[ -s newest.json ]] || fail "nginx does not give $index"
hash=$(python3 -c 'import json; print(json.load(open("newest.json"))["sha256"])')

"${vehicle[@]}" --dump-header headers --output whole.db "$url/$hash.db"
echo "$hash  whole.db" | sha256sum --check --quiet || fail "other bytes"
grep -qi 'immutable' headers || fail "caches may not keep it"
head -c 1000 whole.db >pieces.db
"${vehicle[@]}" --continue-at - --output pieces.db "$url/$hash.db"
cmp whole.db pieces.db || fail "a download that goes on has other bytes"
"$bin/shiftmap-inspect" show --quiet --store whole.db --area 'level 3' >/dev/null

! curl --silent --fail --cacert tls/ca.pem --output no.db "$url/$hash.db" 2>/dev/null || fail "no certificate is needed"
! "${vehicle[@]}" --output no.db "$url/" 2>/dev/null || fail "the folder is listed"
! "${vehicle[@]}" --request DELETE "$url/$hash.db" 2>/dev/null || fail "a file can be deleted"
"$source/tools/certificates.sh" revoke tls truck-7 >/dev/null
/usr/sbin/nginx -c "$folder/nginx.conf" -s reload 2>>nginx.err.log
# Workers from before the reload take connections for a moment.
refused=0
for _ in $(seq 100); do
  if "${vehicle[@]}" --output no.db "$url/$hash.db" 2>/dev/null; then refused=0; else refused=$((refused + 1)); fi
  ((refused < 5)) || break
  sleep 0.1
done
((refused == 5)) || fail "a revoked certificate is taken"
curl --silent --fail --cacert tls/ca.pem --cert tls/truck-8.pem --key tls/truck-8.key --output other.db "$url/$hash.db" ||
  fail "one vehicle's revocation ends another's downloads"
cmp whole.db other.db
echo "mirror: whole, resumed and refused downloads are right"

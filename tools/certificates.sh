#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# A small authority for the map server and its clients: to test, and to start a site with. The
# role of a client is the OU of its certificate, its name the CN. Keys are P-256.
#
#   tools/certificates.sh init DIR                        an authority: DIR/ca.pem, DIR/ca.key, DIR/crl.pem
#   tools/certificates.sh server DIR NAME [ADDRESS...]    NAME.pem, NAME.key for the server at NAME
#                                                         and at more host names or IP addresses
#   tools/certificates.sh client DIR ROLE NAME            for a vehicle, mapper, inspector or operator
#   tools/certificates.sh renew DIR NAME                  another certificate with key, subject and addresses
#   tools/certificates.sh revoke DIR NAME                 all of its certificates, into DIR/crl.pem
#   tools/certificates.sh crl DIR                         the list anew, before it is out of date
#
# In the environment: DAYS, for how long a certificate holds, 365 by default; or ENDS, until when, as
# 20300131235959Z. The server reads changed files by itself.
set -euo pipefail
umask 077

usage() {
  sed -n '3,/^set/{/^set/d;s/^# \{0,1\}//;p}' "$0" >&2
  exit 2
}

fail() {
  echo "certificates: $1" >&2
  exit "${2:-3}"
}

(($# >= 2)) || usage
command=$1 dir=$2
shift 2
days=${DAYS:-365}
authority=(openssl ca -batch -notext -config "$dir/ca.cnf")

# Names are file names and stand in a configuration file.
check_name() {
  [[ $1 =~ ^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$ ]] || fail "'$1': expected letters, digits, . _ -" 2
  [[ $1 != ca && $1 != crl ]] || fail "'$1': is the authority's" 2
}

init() {
  [[ ! -e $dir/ca.key ]] || fail "'$dir': has an authority already" 5
  mkdir -p "$dir/issued"
  cat >"$dir/ca.cnf" <<CONFIG
[ca]
default_ca = authority
[authority]
dir = $(realpath "$dir")
database = \$dir/index.txt
new_certs_dir = \$dir/issued
certificate = \$dir/ca.pem
private_key = \$dir/ca.key
rand_serial = yes
default_md = sha256
default_days = $days
default_crl_days = 30
unique_subject = no
policy = policy
copy_extensions = none
crl_extensions = crl
[policy]
organizationalUnitName = optional
commonName = supplied
[crl]
authorityKeyIdentifier = keyid
[v3_authority]
basicConstraints = critical, CA:true, pathlen:0
keyUsage = critical, keyCertSign, cRLSign
subjectKeyIdentifier = hash
CONFIG
  : >"$dir/index.txt"
  openssl ecparam -name prime256v1 -genkey -noout -out "$dir/ca.key"
  openssl req -new -x509 -config <(printf '[req]\ndistinguished_name = dn\n[dn]\n'; cat "$dir/ca.cnf") \
    -key "$dir/ca.key" -subj "/CN=shiftmap authority $(openssl rand -hex 4)" -days 3650 \
    -extensions v3_authority -out "$dir/ca.pem"
  make_crl
  chmod a+r "$dir/ca.pem" "$dir/crl.pem"
}

make_crl() {
  "${authority[@]}" -gencrl -out "$dir/crl.new" 2>/dev/null
  chmod a+r "$dir/crl.new"
  mv "$dir/crl.new" "$dir/crl.pem"
}

# What openssl says is shown only if it fails.
run_authority() {
  "${authority[@]}" "$@" 2>"$dir/authority.err" || { cat "$dir/authority.err" >&2; exit 70; }
  rm -f "$dir/authority.err"
}

# name, subject; the extensions are in DIR/NAME.ext. What is at NAME.pem is replaced at once.
sign() {
  local name=$1 subject=$2
  [[ -e $dir/$name.key ]] || openssl ecparam -name prime256v1 -genkey -noout -out "$dir/$name.key"
  openssl req -new -key "$dir/$name.key" -subj "$subject" -out "$dir/$name.csr" \
    -config <(printf '[req]\ndistinguished_name = dn\n[dn]\n')
  local period=(-days "$days")
  [[ -z ${ENDS:-} ]] || period=(-enddate "$ENDS")
  run_authority "${period[@]}" -in "$dir/$name.csr" -extfile "$dir/$name.ext" -out "$dir/$name.new"
  rm -f "$dir/$name.csr"
  chmod a+r "$dir/$name.new"
  mv "$dir/$name.new" "$dir/$name.pem"
  printf '%s\n' "$subject" >"$dir/$name.subject"
}

# One that was renewed holds as long as the new one does, with the same key.
revoke() {
  local serials serial
  serials=$(awk -F'\t' -v name="$1" \
    '$1 == "V" { sub(/.*\/CN=/, "", $6); if ($6 == name) print $4 }' "$dir/index.txt")
  [[ -n $serials ]] || fail "'$1': is revoked already" 5
  for serial in $serials; do
    run_authority -revoke "$dir/issued/$serial.pem"
  done
}

extensions() {
  printf '%s\n' 'basicConstraints = critical, CA:false' 'keyUsage = critical, digitalSignature' \
    "extendedKeyUsage = $1" 'authorityKeyIdentifier = keyid'
}

case $command in
  init) init ;;
  server)
    (($# >= 1)) || usage
    name=$1
    check_name "$name"
    addresses=""
    for address in "$@"; do
      [[ $address =~ ^[A-Za-z0-9.:-]+$ ]] || fail "'$address': expected a host name or an address" 2
      kind=DNS
      if [[ $address =~ ^[0-9.]+$ || $address == *:* ]]; then kind=IP; fi
      addresses+="${addresses:+, }$kind:$address"
    done
    { extensions serverAuth; echo "subjectAltName = $addresses"; } >"$dir/$name.ext"
    sign "$name" "/CN=$name"
    ;;
  client)
    (($# == 2)) || usage
    role=$1 name=$2
    check_name "$name"
    [[ $role =~ ^(vehicle|mapper|inspector|operator)$ ]] ||
      fail "'$role': expected vehicle, mapper, inspector or operator" 2
    extensions clientAuth >"$dir/$name.ext"
    sign "$name" "/OU=$role/CN=$name"
    ;;
  renew)
    (($# == 1)) || usage
    check_name "$1"
    [[ -e $dir/$1.subject ]] || fail "'$1': has no certificate here" 6
    sign "$1" "$(<"$dir/$1.subject")"
    ;;
  revoke)
    (($# == 1)) || usage
    check_name "$1"
    [[ -e $dir/$1.pem ]] || fail "'$1': has no certificate here" 6
    revoke "$1"
    make_crl
    ;;
  crl) make_crl ;;
  *) usage ;;
esac

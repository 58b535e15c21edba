#!/usr/bin/env bash
# Test a wheel with the Python of another Debian release in a temporary debootstrap root (requires root):
#   release/debian.sh sid python3.14 dist/omnimirror-0.2.0-cp312-abi3-manylinux_2_35_x86_64.whl
set -euo pipefail
suite=$1 python=$2 wheel=$3
here=$(cd "$(dirname "$0")" && pwd)
root=$(mktemp -d)
trap 'rm -rf --one-file-system "$root"' EXIT
debootstrap --variant=minbase --include="$python,$python-venv,ca-certificates" "$suite" "$root" >"$root.log" ||
  { tail "$root.log"; exit 1; }
# Certificates and name servers of the host.
cp /etc/ssl/certs/ca-certificates.crt "$root/etc/ssl/certs/"
cp /etc/resolv.conf "$root/etc/"
cp "$wheel" "$here/smoke_test.py" "$here/../constraints.txt" "$root/root/"
chroot "$root" /bin/sh -e <<WITHIN
cd /root
$python -m venv own
own/bin/python -m pip install --quiet -c constraints.txt ./$(basename "$wheel")
own/bin/python smoke_test.py
own/bin/python -m omnimirror demo -o demo >/dev/null
WITHIN
rm "$root.log"

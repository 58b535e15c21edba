#!/usr/bin/env bash
# Run test/agreement.cpp on processors that are not at hand, under qemu.
#
#   native/emulate.sh [cases]
#
# NEON by a cross compiler, and on x86 machines without AVX-512 and without AVX2, whose kernels must not be chosen there.
# What is needed: apt-get install g++-aarch64-linux-gnu qemu-user
set -euo pipefail
cd "$(dirname "$0")/.."
cases=${1:-300}
build=build/emulate

run() { # WORDS EMULATOR..
  echo "$1:"
  shift
  "$@" "$cases"
}

for program in aarch64-linux-gnu-g++ qemu-aarch64 qemu-x86_64; do
  command -v "$program" > /dev/null || { echo "there is no $program; apt-get install g++-aarch64-linux-gnu qemu-user"; exit 2; }
done
CXX=aarch64-linux-gnu-g++ native/agreement.sh "$build/neon" -O2 -static
run "NEON" qemu-aarch64 "$build/neon/agreement"
if [ "$(uname -m)" = x86_64 ]; then
  native/agreement.sh "$build/x86" -O2
  run "x86 without AVX-512" qemu-x86_64 -cpu Haswell "$build/x86/agreement"
  run "x86 without AVX2" qemu-x86_64 -cpu Nehalem "$build/x86/agreement"
fi

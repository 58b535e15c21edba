#!/usr/bin/env bash
# Run test/agreement.cpp on processors that are not at hand, under qemu.
#
#   native/emulate.sh [cases]
#
# NEON by a cross compiler, and on x86 machines without AVX-512 and without AVX2, whose kernels must not be chosen there.
# What is needed: apt-get install cmake g++-aarch64-linux-gnu qemu-user
set -euo pipefail
cd "$(dirname "$0")/.."
cases=${1:-300}
build=build/emulate

for program in cmake aarch64-linux-gnu-g++ qemu-aarch64 qemu-x86_64; do
  command -v "$program" > /dev/null || { echo "there is no $program; apt-get install cmake g++-aarch64-linux-gnu qemu-user"; exit 2; }
done

build_for() { # FOLDER [options of cmake]
  local folder=$build/$1
  shift
  cmake -S native -B "$folder" -DOMNIMIRROR_MODULE=OFF -DOMNIMIRROR_TESTS=ON "$@" > /dev/null
  cmake --build "$folder" -j 2 --target test_agreement > /dev/null
}

run() { # WORDS EMULATOR..
  echo "$1:"
  shift
  "$@" "$cases"
}

build_for neon -DCMAKE_SYSTEM_NAME=Linux -DCMAKE_SYSTEM_PROCESSOR=aarch64 -DCMAKE_CXX_COMPILER=aarch64-linux-gnu-g++ \
  -DCMAKE_EXE_LINKER_FLAGS=-static
run "NEON" qemu-aarch64 "$build/neon/test_agreement"
if [ "$(uname -m)" = x86_64 ]; then
  build_for x86
  run "x86 without AVX-512" qemu-x86_64 -cpu Haswell "$build/x86/test_agreement"
  run "x86 without AVX2" qemu-x86_64 -cpu Nehalem "$build/x86/test_agreement"
fi

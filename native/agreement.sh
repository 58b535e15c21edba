#!/usr/bin/env bash
# Build test/agreement.cpp with all sampling kernels that a processor of this kind can have.
#
#   [CXX=compiler] native/agreement.sh FOLDER [flags of the compiler]
#
# The program is FOLDER/agreement. Each kernel is compiled with the instructions of its own, as CMakeLists.txt does.
set -euo pipefail
mkdir -p "$1"
folder=$(cd "$1" && pwd)
shift
cd "$(dirname "$0")"
compiler=${CXX:-c++}
flags=(-std=c++20 -I src -pthread "$@")
target=$("$compiler" -dumpmachine)

objects=()
compile() { # FILE [flags of its own]
  local file=$1
  shift
  local object=$folder/$(basename "$file" .cpp).o
  "$compiler" "${flags[@]}" "$@" -c "$file" -o "$object"
  objects+=("$object")
}

case $target in
  x86_64* | amd64*)
    flags+=(-DOMNIMIRROR_AVX2 -DOMNIMIRROR_AVX512)
    avx2=(-mavx2 -mfma)
    # GCC 12 warns of its own intrinsics.
    avx512=(-mavx512f -mavx512bw -mavx512dq -mavx512vl -mavx512vbmi -Wno-uninitialized -Wno-maybe-uninitialized)
    compile src/sampling/kernels_avx2.cpp "${avx2[@]}"
    compile src/sampling/kernels_avx512.cpp "${avx2[@]}" "${avx512[@]}"
    ;;
  aarch64* | arm64*)
    flags+=(-DOMNIMIRROR_NEON)
    compile src/sampling/kernels_neon.cpp
    ;;
esac
for file in test/agreement.cpp src/pool.cpp src/sampling/{axial,sample,packed,sides,kernels_plain}.cpp; do
  compile "$file"
done
"$compiler" "${flags[@]}" "${objects[@]}" -o "$folder/agreement"

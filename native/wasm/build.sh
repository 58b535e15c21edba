#!/usr/bin/env bash
# The kernel of the Design tab that does without a server, as WebAssembly: src/omnimirror/apps/studio/kernel.wasm. It is
# committed, like the page, so that nobody needs a compiler for it; zig brings one with the libraries of this target:
#   python -m venv out/zig && out/zig/bin/pip install ziglang && native/wasm/build.sh out/zig/bin/python -m ziglang
set -euo pipefail
cd "$(dirname "$0")/../.."
"$@" c++ -target wasm32-wasi -mexec-model=reactor -std=c++20 -O2 -msimd128 -fno-exceptions -fno-rtti -Wall -Wextra -Wno-unused-function \
  -I native/src native/wasm/one_design.cpp -s -o src/omnimirror/apps/studio/kernel.wasm

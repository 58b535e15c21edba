#!/usr/bin/env bash
# Build the compiled samplers with the address and undefined-behaviour sanitizers, and run their tests.
#
#   native/sanitize.sh [python] [arguments of pytest]
#
# The module is built into build/sanitize and loaded in place of the installed one.
set -euo pipefail
cd "$(dirname "$0")/.."
python=${1:-.venv/bin/python}
shift || true
build=build/sanitize
command -v "$python" > /dev/null || { echo "there is no $python; make .venv first"; exit 2; }
compiler=${CXX:-c++}

mkdir -p "$build"
flags="-O1 -g -fsanitize=address,undefined -fno-sanitize-recover=undefined -fno-omit-frame-pointer"
CXX=$compiler native/agreement.sh "$build" $flags
"$build/agreement" 2000

cmake=$("$python" -c 'import shutil, sys, os; print(shutil.which("cmake", path=os.path.dirname(sys.executable)) or "cmake")')
"$cmake" -S native -B "$build/module" -DPython_EXECUTABLE="$("$python" -c 'import sys; print(sys.executable)')" -DCMAKE_BUILD_TYPE=RelWithDebInfo \
  -DOMNIMIRROR_SANITIZE=ON -DCMAKE_CXX_COMPILER="$compiler" > "$build/cmake.log"
"$cmake" --build "$build/module" -j 2 > "$build/build.log" || { cat "$build/build.log"; exit 1; }

cat > "$build/run.py" << 'PYTHON'
"""pytest with the module that was built here."""
import importlib.util
import sys
from pathlib import Path

path = next(Path(__file__).parent.glob("module/_native*.so"))
spec = importlib.util.spec_from_file_location("omnimirror._native", path)
module = importlib.util.module_from_spec(spec)
spec.loader.exec_module(module)
sys.modules["omnimirror._native"] = module

if __name__ == "__main__":  # processes that a test spawns import this file too
    import pytest

    sys.exit(pytest.main(sys.argv[1:]))
PYTHON

# Python itself leaks by design; its threads are never joined.
export ASAN_OPTIONS=detect_leaks=0:abort_on_error=0 UBSAN_OPTIONS=print_stacktrace=1
libraries=$("$compiler" -print-file-name=libasan.so):$("$compiler" -print-file-name=libubsan.so)
LD_PRELOAD=$libraries "$python" "$build/run.py" -p no:cacheprovider \
  tests/contracts/test_samplers.py tests/dewarp/sampling/test_kernels.py tests/dewarp/sampling/test_footprints.py tests/dewarp/test_dewarper.py tests/batch tests/tolerancing/test_trials.py tests/test_torch_tables.py \
  tests/simulate/scenes/test_scenes.py tests/simulate/restoration/test_sharp_picture.py "$@"

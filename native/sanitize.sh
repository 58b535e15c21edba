#!/usr/bin/env bash
# Build the kernels with sanitizers and run their tests.
#
#   native/sanitize.sh [python] [arguments of pytest]
#
# With the address and undefined-behaviour sanitizers: test/agreement.cpp, test/pool.cpp, hostile arguments of all
# bindings, and the tests of all that is compiled. With the thread sanitizer: test/agreement.cpp and test/pool.cpp on
# several threads. CALLS is the number of calls with hostile arguments, 20000 unless given.
set -euo pipefail
cd "$(dirname "$0")/.."
python=${1:-.venv/bin/python}
shift || true
build=build/sanitize
command -v "$python" > /dev/null || { echo "there is no $python; make .venv first"; exit 2; }
compiler=${CXX:-c++}
executable=$("$python" -c 'import sys; print(sys.executable)')
cmake=$("$python" -c 'import shutil, sys, os; print(shutil.which("cmake", path=os.path.dirname(sys.executable)) or "cmake")')
mkdir -p "$build"

build_with() { # FOLDER [options of cmake]
  local folder=$build/$1
  shift
  "$cmake" -S native -B "$folder" -DCMAKE_BUILD_TYPE=RelWithDebInfo -DCMAKE_CXX_COMPILER="$compiler" \
    -DOMNIMIRROR_TESTS=ON "$@" > "$folder.cmake.log" || { cat "$folder.cmake.log"; exit 1; }
  "$cmake" --build "$folder" -j 2 > "$folder.build.log" || { cat "$folder.build.log"; exit 1; }
}

echo "thread sanitizer:"
build_with thread -DOMNIMIRROR_SANITIZE=thread -DOMNIMIRROR_MODULE=OFF
export TSAN_OPTIONS=halt_on_error=1
"$build/thread/test_pool"
"$build/thread/test_agreement" 300

echo "address and undefined-behaviour sanitizers:"
build_with address -DOMNIMIRROR_SANITIZE=address,undefined -DPython_EXECUTABLE="$executable"
"$build/address/test_pool"
"$build/address/test_agreement" 2000

cat > "$build/run.py" << 'PYTHON'
"""A module of Python, run with the compiled module that was built here."""
import importlib.util
import sys
from pathlib import Path

path = next(Path(__file__).parent.glob("address/_native*.so"))
spec = importlib.util.spec_from_file_location("omnimirror.base._native", path)
module = importlib.util.module_from_spec(spec)
spec.loader.exec_module(module)
sys.modules["omnimirror.base._native"] = module

if __name__ == "__main__":  # processes that a test spawns import this file too
    import runpy

    sys.path.insert(0, "")
    sys.argv = sys.argv[1:]
    runpy.run_module(sys.argv[0], run_name="__main__")
PYTHON

# Python itself leaks by design; its threads are never joined.
export ASAN_OPTIONS=detect_leaks=0:abort_on_error=0:allocator_may_return_null=1 UBSAN_OPTIONS=print_stacktrace=1
libraries=$("$compiler" -print-file-name=libasan.so):$("$compiler" -print-file-name=libubsan.so)
LD_PRELOAD=$libraries "$python" "$build/run.py" tests.fuzz.native_arguments --calls "${CALLS:-20000}" --seed "$RANDOM"
LD_PRELOAD=$libraries "$python" "$build/run.py" pytest -p no:cacheprovider -k "not without_memory and not hostile" \
  tests/base/test_native.py tests/contracts/test_samplers.py tests/dewarp/test_sampling.py \
  tests/dewarp/test_footprints.py tests/dewarp/test_dewarper.py tests/optics/batch tests/manufacturing/tolerancing/test_vectorised_trials.py \
  tests/interop/torch tests/simulation/scenes/test_surfaces.py tests/dewarp/restoration/test_deconvolution.py "$@"

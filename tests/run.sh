#!/usr/bin/env bash
# Installs missing packages, builds, and runs every test of the developer build, then those of code that reads what users
# hand over, under the address and undefined-behavior sanitizers. Further arguments go to ctest, whose tests are the files
# of tests/:
#   tests/run.sh -R tools.models
# REVISIT_SKIP_SANITIZERS=1 skips the second part. --sanitizers as the first argument instead runs every test, the
# program and the Python package under the address and undefined-behavior sanitizers, then every test under the thread sanitizer.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
unset OPENBLAS_CORETYPE OPENBLAS_L2_SIZE  # tests need OpenBLAS's own choice

"$root/tools/install_packages.sh"
cd "$root"

# PyPI's packages build and test the Python package; without them cmake reports that it is skipped.
python=$root/build/venv
if ! { [ -x "$python/bin/pip" ] || /usr/bin/python3 -m venv "$python"; } ||
   ! "$python/bin/pip" -q --disable-pip-version-check install --timeout 20 -r python/requirements.txt; then
  echo "no packages from PyPI: without the tests of the Python package, unless they are there already" >&2
fi

run() {  # run PRESET CTEST-ARGUMENTS...
  local preset=$1
  shift
  echo "== $preset: build"
  local options=()
  [ ! -x "$python/bin/python" ] || options=("-DPython_EXECUTABLE=$python/bin/python")
  cmake --preset "$preset" "${options[@]}" >"$root/build/$preset.log" 2>&1 || { cat "$root/build/$preset.log"; return 1; }
  grep "Without the Python" "$root/build/$preset.log" || true
  cmake --build --preset "$preset"
  echo "== $preset: test"
  ctest --preset "$preset" --output-on-failure --parallel 2 "$@" | awk -f "$root/tests/slowest.awk"
}

mkdir -p build
if [ "${1:-}" = --sanitizers ]; then
  shift
  run asan_whole "$@"
  run tsan "$@"
  exit
fi
run dev "$@"
awk '/^\[  SKIPPED \] [0-9]/ { n += $4 } END { if (n) print n " tests say in LastTest.log why they were skipped" }' \
  build/dev/Testing/Temporary/LastTest.log
[ "${REVISIT_SKIP_SANITIZERS:-}" = 1 ] || run readers "$@"

#!/usr/bin/env bash
# Installs what is missing, builds, and runs every test: first the developer build, then the one
# with the address and undefined-behaviour sanitizers. Further arguments go to ctest:
#   tests/run.sh -R models
# REVISIT_SKIP_SANITIZERS=1 leaves the second part out.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
unset OPENBLAS_CORETYPE OPENBLAS_L2_SIZE  # the tests shall see what OpenBLAS chooses itself

"$root/tools/install_packages.sh"
cd "$root"

run() {  # run PRESET CTEST-ARGUMENTS...
  local preset=$1
  shift
  echo "== $preset: build"
  cmake --preset "$preset" >"$root/build/$preset.log" 2>&1 || { cat "$root/build/$preset.log"; return 1; }
  cmake --build --preset "$preset"
  echo "== $preset: test"
  ctest --preset "$preset" --output-on-failure --parallel 2 "$@"
}

mkdir -p build
run dev "$@"
[ "${REVISIT_SKIP_SANITIZERS:-}" = 1 ] || run asan "$@"

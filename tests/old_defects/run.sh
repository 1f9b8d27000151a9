#!/usr/bin/env bash
# Reverts the fix of each old defect and checks that the suite fails. The first line of NAME.patch describes the defect;
# `target:` is the program with the test, `test:` the ctest tests that find it.
#   tests/old_defects/run.sh [COPY] [NAME...]
# COPY is a copy of the tree with a developer build (build/old_defects), created if missing and used again. Exit
# code 1: a defect was not found, or a patch does not apply.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
copy=${1:-$root/build/old_defects}
shift || true
mkdir -p "$copy"
copy=$(cd "$copy" && pwd)
[ "$copy" = "$root" ] || (cd "$root" && git ls-files -z | tar --null -cf - -T -) | tar -C "$copy" -xf -
cd "$copy"
mkdir -p build
cmake --preset dev -DREVISIT_PYTHON=OFF >build/old_defects.log

field() { sed -n "s/^$1: //p" "$2"; }
build_and_test() {  # build_and_test PATCH: the test's output is in build/old_defects.log
  cmake --build build/dev --target "$(field target "$1")" >build/old_defects.log 2>&1 ||
    { tail -30 build/old_defects.log >&2; exit 2; }
  ctest --test-dir build/dev --output-on-failure -R "^$(field test "$1")\$" --no-tests=error >build/old_defects.log 2>&1
}

patches=("${@/%/.patch}")
[ $# -gt 0 ] || mapfile -t patches < <(cd "$root/tests/old_defects" && ls ./*.patch)
patches=("${patches[@]/#/$root/tests/old_defects/}")
for patch in "${patches[@]}"; do  # tests that fail without a patch find nothing
  build_and_test "$patch" || { cat build/old_defects.log; exit 2; }
done
missed=0
for patch in "${patches[@]}"; do
  name=$(basename "$patch" .patch) found=
  if ! patch -p1 --forward --silent --dry-run <"$patch" >/dev/null; then
    found="THE PATCH DOES NOT APPLY"
    missed=1
  else
    patch -p1 --silent <"$patch"
    if build_and_test "$patch"; then
      found="NOT FOUND"
      missed=1
    else
      found=$(grep -oE '^\[  FAILED  \] [A-Za-z0-9_/]+\.[A-Za-z0-9_/]+' build/old_defects.log | cut -c14- | sort -u | head -3 | paste -sd' ') ||
        true
      found=${found:-$(field test "$patch")}
    fi
    patch -p1 --silent --reverse <"$patch"
  fi
  printf '%-26s %s\n' "$name" "$found"
done
exit "$missed"

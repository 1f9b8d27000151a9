#!/usr/bin/env bash
# Runs clang-tidy on our sources (or FILES), with the developer build's compile commands. Silent if there are no findings.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
cd "$root"
build=build/tidy  # configured only: each file by itself
python=()  # with nanobind, if tests/run.sh has run
[ ! -x build/venv/bin/python ] || python=("-DPython_EXECUTABLE=$root/build/venv/bin/python")
[ -f $build/compile_commands.json ] ||
  cmake --preset dev -B $build -DREVISIT_UNITY=0 "${python[@]}" >/dev/null
cmake --build $build --target revisit_caffe_schema revisit_reports revisit_ring_schema >/dev/null  # generated headers
sed -i 's/ -fvect-cost-model=[a-z]*//g; s/ --param=[^ ]*//g' $build/compile_commands.json  # unknown to clang
files=("$@")
skipped=(':!tests/**')
for folder in python/src bench examples; do
  grep -q "/$folder/" $build/compile_commands.json || skipped+=(":!${folder%%/*}/**")
done
[ $# -gt 0 ] || mapfile -t files < <(git ls-files '*.cpp' "${skipped[@]}")
printf '%s\n' "${files[@]}" |
  xargs -P "$(nproc)" -n 4 clang-tidy -p $build --quiet --extra-arg=-Wno-unknown-warning-option 2>/dev/null

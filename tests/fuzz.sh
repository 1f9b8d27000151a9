#!/usr/bin/env bash
# Fuzzes each target for MINUTES of CPU time (default 10) with the address and
# undefined-behavior sanitizers: with clang and libFuzzer if installed, else with g++ and our own
# main(). Runs one target per core at a time.
#   tests/fuzz.sh [MINUTES] [TARGET...]           targets: the tests/fuzz/NAME.cpp with seeds/NAME
# Corpora grow in build/fuzz/corpus; logs are build/fuzz/logs/TARGET.log; a finding is stored in
# build/fuzz/findings/TARGET, with exit code 1. After the fix, its reduced case belongs in
# tests/fuzz/regressions/TARGET, which ctest runs. REVISIT_TEST_DATA: the shared data.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
shared=${REVISIT_TEST_DATA:-$root/../shared}
fuzz=$root/tests/fuzz
build=$root/build/fuzz
minutes=${1:-10}
shift || true
targets=("$@")
[ $# -gt 0 ] || mapfile -t targets < <(cd "$fuzz/seeds" && ls)
mkdir -p "$build/logs"
rm -f "$build/found"

has_libfuzzer() {
  command -v clang++ >/dev/null &&
    echo 'extern "C" int LLVMFuzzerTestOneInput(const unsigned char*, unsigned long) { return 0; }' |
    clang++ -x c++ -fsanitize=fuzzer - -o /dev/null 2>/dev/null
}

build_targets() {
  local options=(-DCMAKE_BUILD_TYPE=RelWithDebInfo "-DCMAKE_CXX_FLAGS_RELWITHDEBINFO=-O1 -g1"
                 -DREVISIT_SANITIZE=address,undefined)
  [ "$engine" = own ] || options+=(-DCMAKE_CXX_COMPILER=clang++ -DREVISIT_FUZZ=ON)
  cmake -S "$root" -B "$build/$engine" -G Ninja "${options[@]}" &&
    cmake --build "$build/$engine" --target "${targets[@]/#/fuzz_}"
}

# Collects seeds, past findings and files of other tests, at most 64 KB of each.
gather_seeds() {  # gather_seeds TARGET FOLDER
  local places=("$fuzz/seeds/$1" "$fuzz/regressions/$1") folder pattern file
  {
    for folder in "${places[@]}"; do [ ! -d "$folder" ] || find "$folder" -type f; done
    grep "^$1 " "$fuzz/shared_seeds.txt" | while read -r _ folder pattern; do
      [ -d "$root/$folder" ] && folder=$root/$folder || folder=$shared/$folder
      [ ! -d "$folder" ] || find "$folder" -type f -name "$pattern"
    done
  } | while read -r file; do
    head -c 65536 "$file" >"$2/$(echo "$file" | sha1sum | head -c 16)"
  done
}

# Words that a byte-wise fuzzer would have to guess.
make_dictionary() {
  case $1 in
    prototxt | net_forward)
      { grep -oE '\b[a-z_0-9]+ = [0-9]+' "$root/proto/caffe_schema.proto" | cut -d' ' -f1
        grep -oE '\b[A-Z][A-Z_]+ = [0-9]+' "$root/proto/caffe_schema.proto" | cut -d' ' -f1
        grep -oE '\{"[A-Za-z]+"' "$root/engine/src/registry.cpp" | tr -d '{"'
      } | sort -u | sed 's/.*/"&"/'
      ;;
    jsonl | report)
      grep -oE '[a-z_0-9]+ = [0-9]+;' "$root/tools/reports.proto" | cut -d' ' -f1 | sort -u | sed 's/.*/"\\"&\\""/'
      ;;
    *) : ;;
  esac
}

# Reads CPU seconds of this shell's children from the output of `times`. (It must run in the shell itself: a pipe or $( )
# is another shell, without children.)
seconds_in() {
  awk 'END { split($1, user, /[ms]/); split($2, kernel, /[ms]/)
             print int(60 * (user[1] + kernel[1]) + user[2] + kernel[2]) }' "$1"
}

fuzz_for() {  # fuzz_for SECONDS TARGET: one run of the program
  local program=$build/$engine/tests/fuzz/fuzz_$2 seeds=$build/seeds/$2
  local corpus=$build/corpus/$2 findings=$build/findings/$2
  if [ "$engine" = libfuzzer ]; then
    local dictionary=()
    [ ! -s "$build/$2.dict" ] || dictionary=(-dict="$build/$2.dict")
    # Freed memory that the sanitizer keeps grows with the run.
    ASAN_OPTIONS=quarantine_size_mb=64 "$program" -max_total_time="$1" -timeout=10 -rss_limit_mb=1024 \
      -malloc_limit_mb=512 -max_len=65536 "${dictionary[@]}" -print_final_stats=1 \
      -artifact_prefix="$findings/" "$corpus" "$seeds"
  else
    "$program" --seeds "$seeds" --seconds "$1" --seed "$(date +%s)" --artifacts "$findings"
  fi
}

fuzz_one() {  # fuzz_one TARGET: runs until the CPU time is used or a finding
  local wanted=$((minutes * 60)) used=0 code=0 left
  rm -rf "$build/seeds/$1"
  mkdir -p "$build/corpus/$1" "$build/findings/$1" "$build/seeds/$1"
  gather_seeds "$1" "$build/seeds/$1"
  make_dictionary "$1" >"$build/$1.dict"
  # Clock time limits a run: on a busy machine several are needed to use the CPU time.
  while [ "$code" = 0 ] && [ "$used" -lt "$wanted" ]; do
    left=$((wanted - used))
    fuzz_for $((left > 20 ? left : 20)) "$1" || code=$?
    times >"$build/$1.times"
    used=$(seconds_in "$build/$1.times")
  done
  echo "processor seconds: $used"
  return "$code"
}

report_one() {  # report_one TARGET CODE
  local log=$build/logs/$1.log case
  case=$(find "$build/findings/$1" -type f -newer "$build/started" | head -1)
  if [ "$2" = 0 ]; then
    echo "$1: no findings in $(grep -a '^processor seconds' "$log" | cut -d' ' -f3) s," \
      "$(grep -aE 'number_of_executed|given cases' "$log" | awk '{ n += $2 == "given" ? $1 + $5 : $2 } END { print n }') cases"
    return
  fi
  echo "$1: ${case:+FINDING, }exit code $2, log $log"
  grep -aE 'ERROR: |runtime error|what\(\)|violated' "$log" | head -3 | sed 's/^/  /' || true
  [ -z "$case" ] || echo "  reproduce: $build/$engine/tests/fuzz/fuzz_$1 $case"
  return 1
}

engine=own
if has_libfuzzer; then engine=libfuzzer; fi
echo "building with $engine into build/fuzz/$engine"
build_targets >"$build/logs/build.log" 2>&1 || { tail -40 "$build/logs/build.log"; exit 2; }

touch "$build/started"
running=0
for target in "${targets[@]}"; do
  if [ "$running" -ge "$(nproc)" ]; then wait -n || true; else running=$((running + 1)); fi
  (
    code=0
    fuzz_one "$target" >"$build/logs/$target.log" 2>&1 || code=$?
    report_one "$target" "$code" || touch "$build/found"
  ) &
done
wait
[ ! -f "$build/found" ]

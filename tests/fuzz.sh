#!/usr/bin/env bash
# Fuzzes each target for MINUTES (10 by default) with the address and undefined-behaviour
# sanitizers: with clang and libFuzzer when they are there, else with g++ and our own main().
#   tests/fuzz.sh [MINUTES] [TARGET...]           targets: the tests/fuzz/NAME.cpp with seeds/NAME
# Corpora grow in build/fuzz/corpus; logs are build/fuzz/logs/TARGET.log; a finding is left in
# build/fuzz/findings/TARGET, and the exit code is then 1. Once it is mended, its reduced case goes
# to tests/fuzz/regressions/TARGET, which ctest runs. REVISIT_TEST_DATA: the shared data.
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

# The seeds, the past findings and what other tests have, at most 64 KB of each.
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
      { grep -oE '\b[a-z_0-9]+ = [0-9]+' "$root/proto/caffe.proto" | cut -d' ' -f1
        grep -oE '\b[A-Z][A-Z_]+ = [0-9]+' "$root/proto/caffe.proto" | cut -d' ' -f1
        grep -oE '\{"[A-Za-z]+"' "$root/engine/src/registry.cpp" | tr -d '{"'
      } | sort -u | sed 's/.*/"&"/'
      ;;
    *) : ;;
  esac
}

fuzz_one() {  # fuzz_one TARGET: runs until the time is over or something is found
  local program=$build/$engine/tests/fuzz/fuzz_$1 seeds=$build/seeds/$1
  local corpus=$build/corpus/$1 findings=$build/findings/$1
  rm -rf "$seeds"
  mkdir -p "$corpus" "$findings" "$seeds"
  gather_seeds "$1" "$seeds"
  if [ "$engine" = libfuzzer ]; then
    make_dictionary "$1" >"$build/$1.dict"
    local dictionary=()
    [ ! -s "$build/$1.dict" ] || dictionary=(-dict="$build/$1.dict")
    "$program" -max_total_time=$((minutes * 60)) -timeout=10 -rss_limit_mb=1024 \
      -malloc_limit_mb=512 -max_len=65536 "${dictionary[@]}" -print_final_stats=1 \
      -artifact_prefix="$findings/" "$corpus" "$seeds"
  else
    "$program" --seeds "$seeds" --seconds $((minutes * 60)) --seed "$(date +%s)" \
      --artifacts "$findings"
  fi
}

engine=own
if has_libfuzzer; then engine=libfuzzer; fi
echo "building with $engine into build/fuzz/$engine"
build_targets >"$build/logs/build.log" 2>&1 || { tail -40 "$build/logs/build.log"; exit 2; }

status=0
for target in "${targets[@]}"; do
  log=$build/logs/$target.log
  code=0
  touch "$build/started"
  fuzz_one "$target" >"$log" 2>&1 || code=$?
  case=$(find "$build/findings/$target" -type f -newer "$build/started" | head -1)
  if [ "$code" = 0 ]; then
    echo "$target: no findings ($(grep -aE 'number_of_executed|given cases' "$log" | tr -s ' '))"
    continue
  fi
  status=1
  echo "$target: ${case:+FINDING, }exit code $code, log $log"
  grep -aE 'ERROR: |runtime error|what\(\)|violated' "$log" | head -3 | sed 's/^/  /' || true
  [ -z "$case" ] || echo "  reproduce: $build/$engine/tests/fuzz/fuzz_$target $case"
done
exit $status

#!/usr/bin/env bash
# Demo from a fresh checkout, with Debian packages only. Arguments are added to `revisit eval`, e.g.
# --model P --weights W for the paper's method with that network.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
output="$root/results/demo"
revisit="$root/build/release/tools/revisit"
step() { printf '\n== %s\n' "$*"; }

step "1/4  build"
"$root/tools/build.sh" demo
mkdir -p "$output"

step "2/4  drive: a 64-beam LiDAR through a synthetic town, some streets twice"
"$revisit" simulate --output "$output/town" --length 600 --every 5 | sed -n 1p

step "3/4  evaluate: every scan against all scans from more than 50 m before"
"$revisit" eval "$output/town" --output "$output" --protocol online --exclusion meters=50 \
  --radius 5 --distance xz "$@"

run=$(cd "$output/town_00/latest" && pwd -P)
metric() { sed -n "s/^ *\"$1\": \([0-9.e-]*\),*$/\1/p" "$run/run.json" | head -1; }
awk -v positives="$(metric n_positives)" -v top="$(metric recall_at_1)" \
  -v safe="$(metric max_recall_at_precision_1)" 'BEGIN {
    printf "\nWhat it means: %d scans were taken where the car had been before (within 5 m).\n", positives
    printf "For %.0f %% of them the most similar earlier scan was of that place;\n", 100 * top
    printf "%.0f %% can be accepted without a single false alarm.\n", 100 * safe
  }'

step "4/4  detect loops online, without poses; the threshold was calibrated in another town"
"$revisit" simulate --output "$output/other_town" --seed 2 --length 400 --every 5 --quiet
"$revisit" loops "$output/town" --calibrate "$output/other_town" --exclusion meters=50 --all \
  --format jsonl --output "$output/loops.jsonl"
"$revisit" report "$output/loops.jsonl" -o "$output/loops.html"

echo
echo "Look at, in a browser:"
echo "  $output/loops.html: the map of loops, as a robot finds them"
echo "  $run/report.html: curves, and the drive with correct, incorrect and missed places"

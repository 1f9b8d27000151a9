#!/usr/bin/env bash
# Demo from a fresh checkout: builds the program with the packages of the system, simulates a drive between houses that look alike,
# compares two methods on it, and finds its loops as a robot would.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
output="$root/results/demo"
revisit="$root/build/release/tools/revisit"
step() { printf '\n== %s\n' "$*"; }

step "1/4  build"
"$root/tools/build.sh" demo
mkdir -p "$output"
cd "$output"

step "2/4  drive: a VLP-16 between rows of equal houses, some streets twice, in both directions"
"$revisit" simulate -o rows --surroundings rows --sensor vlp16 --route both --length 600 --every 4 | sed -n 1p

step "3/4  two methods: each scan is compared with those from more than 50 m before"
for method in ring scan-context; do
  "$revisit" eval rows --feature $method --exclusion meters=50 -o $method --no-report --quiet
done
"$revisit" report {ring,scan-context}/rows_00/latest -o methods.html --quiet

step "4/4  loops as a robot finds them: registered, with the pose between both scans"
"$revisit" loops rows --exclusion meters=50 -o loops.csv --view

echo
echo "Open in a browser:"
echo "  $output/methods.html: precision and recall of both methods, maps of correct, incorrect and missed places"
echo "  $output/loops.html: the trajectory with its loops"

#!/usr/bin/env bash
# Measures the tables of the pages anew: docs/data/*.json, then README.md and docs/. Takes hours and 6 GB in FOLDER.
#
#   tests/bench/results.sh [FOLDER]      FOLDER: for simulated drives (default results/tables)
#
# Needs the drives of REAL (../shared/real), KITTI's poses and calibration (KITTI), SqueezeNet v1.0 (SQUEEZENET), the program (REVISIT),
# and a Python with its package, map-closures and kiss-icp (PYTHON). Rows of kitti00 were judged once and are not run again.
set -euo pipefail

cd "$(dirname "${BASH_SOURCE[0]}")/../.."
work=${1:-results/tables}
real=${REAL:-../shared/real}
kitti=${KITTI:-../shared/data/kitti}
squeezenet=${SQUEEZENET:-../shared/data/caffemodels/squeezenet_v1.0}
revisit=${REVISIT:-build/release/tools/revisit}
python=${PYTHON:-python3}
mkdir -p "$work"

# Towns 3, 7 and 8 teach: what rings, Scan Context and M2DP learn.
net=$work/ring16/ring16_random
[ -e "$net.prototxt" ] || "$revisit" models make-random --net ring16 --seed 1 -o "$work/ring16"
towns=()
for seed in 3 7 8; do
  towns+=("$work/vlp16-$seed")
  "$revisit" simulate -o "${towns[-1]}" --sensor vlp16 --route both --length 2400 --every 4 --seed $seed --quiet
  "$python" tests/bench/discriminants.py features "${towns[-1]}" -o "${towns[-1]}.npz"
done
"$revisit" learn "${towns[@]}" --sensor vlp16 --from scans --model "$net.prototxt" --weights "$net.caffemodel" \
  --layers pool1=64 -o "$work/vlp16-scans.ring" --quiet
"$python" tests/bench/discriminants.py learn "${towns[@]/%/.npz}" -o "$work/vlp16.npz"

run() {  # run FILE DRIVE NAME OPTION...
  "$python" tests/bench/real_drives.py "$2" --name "$3" --json "docs/data/$1.json" "${@:4}"
}
methods() {  # methods FILE DRIVE SENSOR_OF_IMAGES
  run "$1" "$2" "rings" --method ring
  run "$1" "$2" "rings, not registered" --method ring --no-verify
  if [ "$(basename "$2")" != riverside ]; then  # which has no poses
    run "$1" "$2" "rings, local maps of 10 m" --method ring --sensor hdl64 --local-map 10
  fi
  run "$1" "$2" "rings without training, not registered" --method ring --no-verify --ring "$work/vlp16-scans.ring"
  run "$1" "$2" "Scan Context, all candidates" --method scan-context
  run "$1" "$2" "Scan Context, 10 by ring keys" --method scan-context --ring-keys 10
  run "$1" "$2" "Scan Context, learnt as rings" --method learnt --feature scan-context --discriminants "$work/vlp16.npz"
  run "$1" "$2" "M2DP" --method m2dp
  run "$1" "$2" "M2DP, learnt as rings" --method learnt --feature m2dp --discriminants "$work/vlp16.npz"
  run "$1" "$2" "the paper's feature, aligned" --method cnn --model "$squeezenet" --sensor "$3" --align case1
  run "$1" "$2" "the paper's feature, both cases" --method cnn --model "$squeezenet" --sensor "$3" --align both
  run "$1" "$2" "the paper's feature, not aligned" --method cnn --model "$squeezenet" --sensor "$3" --align none
  run "$1" "$2" "MapClosures, local maps of 100 m" --method map-closures --local-map 100
  run "$1" "$2" "MapClosures, local maps of 20 m" --method map-closures --local-map 20
}
methods real_drives "$real/nclt" hdl32
methods real_drives "$real/riverside" ouster-os1-64
# What the test documents.rows runs again.
run real_drives "$real/riverside" "Scan Context, all candidates" --method scan-context --cheap
run simulated_drives town:11 "rings" --method ring --cheap
# Towns 11 and 12 were used neither for learning nor for choosing.
for seed in 11 12; do
  drive=$work/town$seed-08
  "$revisit" simulate -o "$drive" --sensor vlp16 --sequence 08 --poses "$kitti/poses/08.txt" \
    --calib "$kitti/sequences/08/calib.txt" --every 4 --seed $seed --quiet
  methods simulated_drives "$drive" vlp16
done
"$python" tests/bench/tables.py

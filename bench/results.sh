#!/usr/bin/env bash
# Measures docs/data/*.json again and updates the tables of README.md and docs/. Takes hours and 20 GB in FOLDER.
# If interrupted, run it again to resume: rows in docs/data/ are not measured again. To measure a file again, delete it.
#
#   bench/results.sh [FOLDER]      FOLDER: for simulated drives and trained models (default results/tables)
#   TOWNS=11 ROUTES=08 SENSORS=vlp16 bench/results.sh            only this part of the table of towns
#   PCD_FILES=FOLDER ...                 also the drive pcd_files: FOLDER has the 485 scans of github.com/JeisonPham/pcd_files, 6fbb89d2
#
# Needs the drives of REAL (../shared/real), KITTI's poses and calibration (KITTI), SqueezeNet v1.0 (SQUEEZENET), the program (REVISIT),
# and a Python with its package, map-closures and kiss-icp (PYTHON). Rows of kitti00 are not measured again.
set -euo pipefail

cd "$(dirname "${BASH_SOURCE[0]}")/.."
work=${1:-results/tables}
real=${REAL:-../shared/real}
kitti=${KITTI:-../shared/data/kitti}
squeezenet=${SQUEEZENET:-../shared/data/caffemodels/squeezenet_v1.0}
revisit=${REVISIT:-build/release/tools/revisit}
python=${PYTHON:-python3}
part=${TOWNS-}${ROUTES-}${SENSORS-}  # not empty: only a part of the table of towns
read -ra towns <<<"${TOWNS:-11 12 13 14 15}"
read -ra routes <<<"${ROUTES:-08 06 05 00}"
read -ra sensors <<<"${SENSORS:-vlp16 hdl64 ouster-os1-64}"
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1  # a process for each core
export REVISIT=$revisit
mkdir -p "$work"

# Trains on towns 3 and 7: the statistics of untrained ring descriptors, and the discriminant analysis of Scan Context and M2DP.
learn() {  # learn SENSOR
  local known=$work/$1 net=$work/ring16/ring16_random
  [ -e "$known.npz" ] && return
  [ -e "$net.prototxt" ] || "$revisit" models make-random --net ring16 --seed 1 -o "$work/ring16"
  for seed in 3 7; do
    "$revisit" simulate -o "$known-$seed" --sensor "$1" --route both --length 2400 --every 4 --seed $seed --quiet
    "$python" bench/discriminants.py features "$known-$seed" -o "$known-$seed.npz"
  done
  "$revisit" train "$known-3" "$known-7" --sensor "$1" --from scans --model "$net.prototxt" --weights "$net.caffemodel" \
    --layers pool1=64 -o "$known-scans.ring" --quiet
  rm -r "$known-3" "$known-7"
  "$python" bench/discriminants.py learn "$known"-[37].npz -o "$known.npz"
}

run() {  # run FILE DRIVE NAME OPTION...
  "$python" bench/real_drives.py "$2" --name "$3" --json "docs/data/$1.json" --missing "${@:4}"
}
compared() {  # compared FILE DRIVE SENSOR_OF_TRAINED_MODELS OPTION...: methods of every table
  run "$1" "$2" "rings" --method ring "${@:4}"
  run "$1" "$2" "rings, not registered" --method ring --no-verify "${@:4}"
  run "$1" "$2" "rings without training, not registered" --method ring --no-verify --ring "$work/$3-scans.ring" "${@:4}"
  run "$1" "$2" "Scan Context, all candidates" --method scan-context "${@:4}"
  run "$1" "$2" "Scan Context, 10 by ring keys" --method scan-context --ring-keys 10 "${@:4}"
  run "$1" "$2" "Scan Context, learnt as rings" --method learnt --feature scan-context --discriminants "$work/$3.npz" "${@:4}"
}
m2dp() {  # as compared()
  run "$1" "$2" "M2DP" --method m2dp "${@:4}"
  run "$1" "$2" "M2DP, learnt as rings" --method learnt --feature m2dp --discriminants "$work/$3.npz" "${@:4}"
}
methods() {  # methods FILE DRIVE SENSOR_OF_IMAGES
  if [ ! -d "$2/first" ]; then  # without poses
    run "$1" "$2" "rings, local maps of 10 m" --method ring --sensor hdl64 --local-map 10
  fi
  compared "$1" "$2" vlp16
  m2dp "$1" "$2" vlp16
  run "$1" "$2" "the paper's feature, aligned" --method cnn --model "$squeezenet" --sensor "$3" --align case1
  run "$1" "$2" "the paper's feature, both cases" --method cnn --model "$squeezenet" --sensor "$3" --align both
  run "$1" "$2" "the paper's feature, not aligned" --method cnn --model "$squeezenet" --sensor "$3" --align none
  run "$1" "$2" "MapClosures, local maps of 100 m" --method map-closures --local-map 100
  run "$1" "$2" "MapClosures, local maps of 20 m" --method map-closures --local-map 20
}
drive_of() {  # drive_of FOLDER TOWN ROUTE SENSOR OPTION...
  "$revisit" simulate -o "$1" --sensor "$4" --sequence "$3" --poses "$kitti/poses/$3.txt" --calib "$kitti/sequences/$3/calib.txt" \
    --seed "$2" --quiet "${@:5}"
}
town() {  # town TOWN ROUTE SENSOR: simulates the drive, evaluates keyframes of 1 m and every frame, deletes it
  local drive=$work/town$1-$2-$3
  [ -e "$drive.done" ] && return
  drive_of "$drive" "$1" "$2" "$3"
  compared towns "$drive" "$3" --keyframes 1
  compared towns "$drive" "$3"
  if [ "$1" -le 12 ]; then m2dp towns "$drive" "$3" --keyframes 1; fi
  if [ "$1" -eq 11 ] && [ "$2" = 08 ]; then
    run towns "$drive" "the paper's feature, both cases" --method cnn --model "$squeezenet" --sensor "$3" --align both --keyframes 1
  fi
  rm -rf "$drive"
  touch "$drive.done"
}

for sensor in "${sensors[@]}"; do learn "$sensor"; done
if [ -z "$part" ]; then
  methods real_drives "$real/nclt" hdl32
  methods real_drives "$real/riverside" ouster-os1-64
  if [ "${PCD_FILES:-}" ]; then  # pairs: found by matching each scan with each, with thresholds set by hand
    mkdir -p "$work/pcd_files/"{first,second}
    for scan in $(cd "$PCD_FILES" && ls ??????.pcd); do
      lap=first && [[ "$scan" < 000300 ]] || lap=second
      ln -sf "$(realpath "$PCD_FILES/$scan")" "$work/pcd_files/$lap/"
    done
    cp bench/pcd_files/*.csv "$work/pcd_files"
    methods real_drives "$work/pcd_files" vlp16
  fi
  if [ ! -e docs/data/perturbed_scans.json ]; then
    for drive in nclt riverside; do
      run perturbed_scans "$real/$drive" "rings" --method ring --perturb standard
      run perturbed_scans "$real/$drive" "Scan Context" --method scan-context --perturb standard
    done
  fi
  # Towns 11 to 15 were used neither for training nor for choosing settings.
  drive_of "$work/town11-08" 11 08 vlp16 --every 4
  methods simulated_drives "$work/town11-08" vlp16
  # Rolling shutter without deskewing, noise, lost points: no model was trained on such scans.
  drive_of "$work/town15-08-poor" 15 08 vlp16 --every 4 --rolling-shutter --noise 0.06 --dropout 0.3
  compared simulated_drives "$work/town15-08-poor" vlp16
fi
export -f town drive_of compared m2dp run
export work kitti squeezenet revisit python
for route in "${routes[@]}"; do
  for town in "${towns[@]}"; do
    for sensor in "${sensors[@]}"; do echo "$town $route $sensor"; done
  done
done | xargs -P "$(nproc)" -I{} bash -euo pipefail -c 'town {}'
# Rows that the test documents.rows reruns; they are marked `cheap` and measured again here.
if [ -z "$part" ]; then
  run() { "$python" bench/real_drives.py "$2" --name "$3" --json "docs/data/$1.json" "${@:4}"; }
  run perturbed_scans "$real/riverside" "rings" --method ring --perturb sector=180 --cheap
  run real_drives "$real/riverside" "Scan Context, all candidates" --method scan-context --cheap
  run simulated_drives town:11 "rings" --method ring --cheap
  run towns town:12 "Scan Context, all candidates" --method scan-context --keyframes 1 --cheap
fi
"$python" bench/tables.py
[ -n "$part" ] || "$python" bench/figures.py --revisit "$revisit" --real "$real"

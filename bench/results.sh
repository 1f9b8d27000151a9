#!/usr/bin/env bash
# Measures docs/data/*.json again and updates the tables of README.md and docs/. Takes hours and 20 GB in FOLDER.
# If interrupted, run it again to resume: rows in docs/data/ are not measured again. To measure a row again, delete it.
#
#   bench/results.sh [FOLDER]      FOLDER: for simulated drives and trained models (default results/tables)
#   DRIVES="nclt riverside" bench/results.sh                     only these real drives, all rows again
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
missing=--missing
[ -z "${DRIVES:-}" ] || missing=
read -ra drives <<<"${DRIVES:-nclt riverside mid360_walk greenhouse_small ${PCD_FILES:+pcd_files}}"
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

# A drive is the array `data`: DATA, and options of its poses, pairs and keyframes. file and drive: of its rows.
own() {  # own NAME OPTION...: a row of `revisit eval`
  "$python" bench/rows.py "$file" "$drive" "$1" $missing -- revisit eval "${data[@]}" "${@:2}"
}
foreign() {  # foreign NAME OPTION...
  "$python" bench/rows.py "$file" "$drive" "$1" $missing -- bench/foreign.py "${data[@]}" "${@:2}"
}
compared() {  # compared SENSOR_OF_TRAINED_MODELS: methods of every table
  learn "$1"
  own "rings"
  own "rings, not registered" --score distinct-margin
  own "rings without training, not registered" --ring "$work/$1-scans.ring" --score distinct-margin
  own "Scan Context, all candidates" --feature scan-context
  own "Scan Context, 10 by ring keys" --feature scan-context --candidates 10
  foreign "Scan Context, learnt as rings" --method learnt --feature scan-context --discriminants "$work/$1.npz"
}
m2dp() {  # as compared()
  own "M2DP" --feature m2dp
  foreign "M2DP, learnt as rings" --method learnt --feature m2dp --discriminants "$work/$1.npz"
}
paper() {  # paper SENSOR_OF_IMAGES NAME OPTION...: PCA of all scans
  own "the paper's feature, $2" --protocol online --model "$squeezenet/deploy.prototxt" --weights "$squeezenet/weights.caffemodel" \
    --end pool8 --mean 104,117,123 --sensor "$1" "${@:3}"
}
methods() {  # methods SENSOR_OF_IMAGES
  if [[ " ${data[*]} " != *" --pairs "* ]]; then own "rings, local maps of 10 m" --local-map 10; fi
  compared vlp16
  m2dp vlp16
  paper "$1" aligned --align case1
  paper "$1" "both cases" --align case1 --query-case both
  paper "$1" "not aligned" --align none
  foreign "MapClosures, local maps of 100 m" --method map-closures --local-map 100
  foreign "MapClosures, local maps of 20 m" --method map-closures --local-map 20
}
perturbed() {
  own "rings" --perturb standard
  own "Scan Context" --feature scan-context --perturb standard
}
simulated() {  # simulated NAME TOWN ROUTE SENSOR OPTION...: sets drive and data
  drive=$1 data=("$work/$1" --exclusion meters=50 --negative-radius 10)
  "$revisit" simulate -o "$work/$1" --sensor "$4" --sequence "$3" --poses "$kitti/poses/$3.txt" --calib "$kitti/sequences/$3/calib.txt" \
    --seed "$2" --quiet "${@:5}"
}
town() {  # town TOWN ROUTE SENSOR: simulates the drive, evaluates keyframes of 1 m and every frame, deletes it
  local file=towns drive=town$1-$2-$3 data
  [ -e "$work/$drive.done" ] && return
  simulated "$drive" "$1" "$2" "$3"
  compared "$3"
  if [ "$1" -eq 11 ] && [ "$2" = 08 ]; then paper "$3" "both cases" --align case1 --query-case both; fi
  data+=(--keyframes meters=1)
  compared "$3"
  if [ "$1" -le 12 ]; then m2dp "$3"; fi
  rm -rf "${work:?}/$drive"
  touch "$work/$drive.done"
}

real_drive() {  # real_drive DRIVE
  local file=real_drives drive=$1 data
  case $drive in
    nclt) data=("${nclt[@]}") && methods hdl32 ;;
    riverside) data=("${riverside[@]}") && methods ouster-os1-64 ;;
    mid360_walk)
      data=("$real/$drive/bin" --pairs "$real/$drive/pairs.csv,ignore=$real/$drive/ignore.csv" --exclusion frames=95)
      own "rings"
      own "rings, not registered" --score distinct-margin
      own "rings, local maps of 10 m" --local-map 10
      own "Scan Context, all candidates" --feature scan-context
      ;;
    greenhouse_small)  # its frames begin at 130, its poses at the first line
      local poses=$real/$drive/poses_kitti.txt
      { for _ in {1..130}; do head -1 "$poses"; done && cat "$poses"; } >"$work/greenhouse_poses.txt"
      data=("$real/$drive/bin" --poses "$work/greenhouse_poses.txt" --pose-frame lidar --exclusion meters=50 --negative-radius 10)
      own "rings"
      own "rings, local maps of 10 m" --local-map 10
      own "Scan Context, all candidates" --feature scan-context
      ;;
    pcd_files)  # pairs: found by matching each scan with each, with thresholds set by hand
      mkdir -p "$work/pcd_files/"{first,second}
      for scan in $(cd "$PCD_FILES" && ls ??????.pcd); do
        lap=first && [[ "$scan" < 000300 ]] || lap=second
        ln -sf "$(realpath "$PCD_FILES/$scan")" "$work/pcd_files/$lap/"
      done
      data=("$work/pcd_files" --pairs bench/pcd_files/loops.csv,bench/pcd_files/loops_weak.csv,near=2 --exclusion frames=246)
      methods vlp16
      ;;
  esac
}

if [ "${DRIVES:-}" ]; then sensors=(); fi
for sensor in "${sensors[@]}"; do learn "$sensor"; done
nclt=("$real/nclt/bin" --poses "$real/nclt/poses_kitti.txt" --pose-frame lidar --exclusion meters=50 --negative-radius 10)
lists=$real/riverside/loops
listed=("$real/riverside" --pairs "$lists.csv,${lists}_weak.csv,${lists}_by_time.csv,near=2")
riverside=("${listed[@]},bench/riverside/without_place.csv" --exclusion frames=332)  # excludes its own lap
if [ -z "$part" ]; then
  for drive in "${drives[@]}"; do real_drive "$drive"; done
fi
if [ "${DRIVES:-}" ]; then exec "$python" bench/tables.py; fi
if [ -z "$part" ]; then
  file=perturbed_scans
  drive=nclt data=("${nclt[@]}")
  perturbed
  drive=riverside data=("${listed[@]}")
  perturbed
  file=simulated_drives
  # Towns 11 to 15 were used neither for training nor for choosing settings.
  simulated town11-08 11 08 vlp16 --every 4
  methods vlp16
  # Rolling shutter without deskewing, noise, lost points: no model was trained on such scans.
  simulated town15-08-poor 15 08 vlp16 --every 4 --rolling-shutter --noise 0.06 --dropout 0.3
  compared vlp16
fi
export -f town learn simulated compared m2dp paper own foreign
export work kitti squeezenet revisit python missing
for route in "${routes[@]}"; do
  for town in "${towns[@]}"; do
    for sensor in "${sensors[@]}"; do echo "$town $route $sensor"; done
  done
done | xargs -P "$(nproc)" -I{} bash -euo pipefail -c 'town {}'
# Rows that the test documents.rows measures again.
if [ -z "$part" ]; then
  cheap() {  # cheap FILE DRIVE NAME OPTION...
    "$python" bench/rows.py "$1" "$2" "$3" --cheap -- revisit eval "${@:4}"
  }
  cheap real_drives nclt "rings" "${nclt[@]}"
  cheap perturbed_scans riverside "rings" "${listed[@]}" --perturb sector=180
  cheap simulated_drives town:11 "rings" town:11 --exclusion meters=50
  cheap towns town:12 "Scan Context, all candidates" town:12 --exclusion meters=50 --feature scan-context --keyframes meters=1
fi
"$python" bench/tables.py
[ -n "$part" ] || "$python" bench/figures.py --revisit "$revisit" --real "$real"

#!/usr/bin/env bash
# Trains and calibrates pipeline/recognition/ring_models/SENSOR.ring on simulated drives, which take
# 25 GB in FOLDER (default results/ring_models) and half an hour. With the files of SqueezeNet v1.0
# it also makes the models with its features, SENSOR-squeezenet.ring.
#   tools/train_ring_models.sh [FOLDER [DEPLOY.PROTOTXT WEIGHTS.CAFFEMODEL]]
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
revisit=${REVISIT:-$root/build/release/tools/revisit}
work=${1:-$root/results/ring_models}
mkdir -p "$work"

simulate() {  # simulate FOLDER OPTION...
  "$revisit" simulate -o "$1" --every 4 --quiet "${@:2}"
}
calibrate() {  # calibrate SENSOR MODEL [OPTION...]
  local sensor=$1 model=$2 drives=()
  for surroundings in town village country motorway car-park old-town; do
    # Half of the drives have few revisits: most of their scans show new places.
    route=both
    case $surroundings in village | motorway | car-park) route=loop ;; esac
    drives+=("$work/$sensor-$surroundings")
    simulate "${drives[-1]}" --sensor "$sensor" --surroundings $surroundings --route $route \
      --length 1600 --seed 31
  done
  "$revisit" calibrate "$model" "${drives[@]}" "${@:3}"
}

for sensor in hdl64 vlp16 ouster-os1-64; do
  net=ring64
  [ $sensor != vlp16 ] || net=ring16
  "$revisit" models make-random --net $net --seed 1 -o "$work/$net" >"$work/$net.log" 2>&1
  drives=()
  for seed in 3 7 8; do
    drives+=("$work/$sensor-$seed")
    simulate "${drives[-1]}" --sensor $sensor --route both --length 2400 --seed $seed
  done
  model=$root/pipeline/recognition/ring_models/$sensor
  "$revisit" train "${drives[@]}" --sensor $sensor --model "$work/$net/${net}_random.prototxt" --layers pool1=64 \
    --weights "$work/$net/${net}_random.caffemodel" --cache "$work/$sensor-rings" -o "$model.ring"
  calibrate $sensor "$model.ring"
  [ $# -eq 3 ] || continue
  layers=pool1=32,pool4=32
  [ $sensor != vlp16 ] || layers=pool1=64  # 16 rows are too few for the deeper layer
  "$revisit" train "${drives[@]}" --sensor $sensor --model "$2" --weights "$3" --layers $layers \
    --cache "$work/$sensor-rings" -o "$model-squeezenet.ring"
  calibrate $sensor "$model-squeezenet.ring" --weights "$3"
done

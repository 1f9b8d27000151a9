#!/usr/bin/env bash
# Trains and calibrates pipeline/recognition/ring_models/SENSOR.ring on simulated drives, which take
# 25 GB in FOLDER (default results/ring_models) and half an hour. With the files of SqueezeNet v1.0
# it also makes the models of cars' sensors with its features, SENSOR-squeezenet.ring.
#   tools/train_ring_models.sh [FOLDER [DEPLOY.PROTOTXT WEIGHTS.CAFFEMODEL]]
# $SENSORS, e.g. "vlp16 livox-mid360", are those that are made; default: all.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
revisit=${REVISIT:-$root/build/release/tools/revisit}
work=${1:-$root/results/ring_models}
mkdir -p "$work"

simulate() {  # simulate FOLDER OPTION...
  "$revisit" simulate -o "$1" --every "${every:-4}" --quiet "${@:2}"
}
calibrate() {  # calibrate SENSOR MODEL [OPTION...]; $height of the sensor
  local sensor=$1 model=$2 drives=()
  for surroundings in town village country motorway car-park old-town; do
    # Half of the drives have few revisits: most of their scans show new places.
    route=both
    case $surroundings in village | motorway | car-park) route=loop ;; esac
    drives+=("$work/$sensor-$surroundings")
    simulate "${drives[-1]}" --sensor "$sensor" --surroundings $surroundings --route $route \
      --length 1600 --sensor-height $height --seed 31
  done
  "$revisit" calibrate "$model" "${drives[@]}" "${@:3}"
}

# Drives of persons and robots: several surroundings, heights and tilts of the sensor.
carried_drives() {  # carried_drives SENSOR
  local seed=11 pitch=(3 0 0 -3 0) roll=(0 4 0 0 -4)
  for surroundings in suburb old-town town country village; do
    drives+=("$work/$1-$surroundings-$seed")
    simulate "${drives[-1]}" --sensor "$1" --surroundings $surroundings --route both --length 800 \
      --sensor-height $height --sensor-pitch "${pitch[seed - 11]}" \
      --sensor-roll "${roll[seed - 11]}" --seed $seed
    seed=$((seed + 1))
  done
  for surroundings in garage office-irregular office-carried forest container-yard; do
    drives+=("$work/$1-$surroundings-$seed")
    every=16 simulate "${drives[-1]}" --sensor "$1" --surroundings $surroundings --seed $seed
    seed=$((seed + 1))
  done
}

for sensor in hdl64 vlp16 ouster-os1-64 livox-mid360; do
  [[ " ${SENSORS:-$sensor} " == *" $sensor "* ]] || continue
  net=ring64 height=1.73
  case $sensor in vlp16) net=ring16 ;; livox-mid360) net=ring32 height=1 ;; esac
  "$revisit" models make-random --net $net --seed 1 -o "$work/$net" >"$work/$net.log" 2>&1
  drives=()
  if [ $sensor = livox-mid360 ]; then
    carried_drives $sensor
  else
    for seed in 3 7 8; do
      drives+=("$work/$sensor-$seed")
      simulate "${drives[-1]}" --sensor $sensor --route both --length 2400 --seed $seed
    done
  fi
  model=$root/pipeline/recognition/ring_models/$sensor
  "$revisit" train "${drives[@]}" --sensor $sensor --sensor-height $height --layers pool1=64 \
    --model "$work/$net/${net}_random.prototxt" --weights "$work/$net/${net}_random.caffemodel" \
    --cache "$work/$sensor-rings" -o "$model.ring"
  calibrate $sensor "$model.ring"
  if [ $# -lt 3 ] || [ $sensor = livox-mid360 ]; then continue; fi
  layers=pool1=32,pool4=32
  [ $sensor != vlp16 ] || layers=pool1=64  # 16 rows are too few for the deeper layer
  "$revisit" train "${drives[@]}" --sensor $sensor --model "$2" --weights "$3" --layers $layers \
    --cache "$work/$sensor-rings" -o "$model-squeezenet.ring"
  calibrate $sensor "$model-squeezenet.ring" --weights "$3"
done

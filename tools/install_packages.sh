#!/usr/bin/env bash
# Installs the packages of packages.txt that are missing, on Debian 12, Ubuntu 22.04 and 24.04.
# Usage: install_packages.sh [engine|demo|program|packing]
set -euo pipefail

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
case "${1:-all}" in
  all) list=$(cat "$here/packages.txt") ;;
  engine | demo | program | packing) list=$(sed "/^# --- $1 ends here/,\$d" "$here/packages.txt") ;;
  *) echo "usage: $0 [engine|demo|program|packing]" >&2; exit 2 ;;
esac
wanted=$(sed 's/#.*//' <<<"$list" | xargs -n1)

if ! command -v dpkg-query >/dev/null; then
  echo "not a Debian system: install what matches these packages by hand:" $wanted >&2
  exit 1
fi
installed=$(dpkg-query -W -f='${db:Status-Abbrev} ${Package}\n' $wanted 2>/dev/null | awk '$1 == "ii" {print $2}' || true)
missing=$(comm -23 <(sort -u <<<"$wanted") <(sort -u <<<"$installed") | xargs)
[ -n "$missing" ] || exit 0

as_root=()
if [ "$(id -u)" -ne 0 ]; then
  if sudo -n true 2>/dev/null || { [ -t 0 ] && command -v sudo >/dev/null; }; then  # may ask for a password
    as_root=(sudo)
  else
    echo "packages are missing; install them as root:" >&2
    echo "  apt-get install --no-install-recommends $missing" >&2
    exit 1
  fi
fi

# Package lists may be absent. Ubuntu 24.04 has no FAISS: revisit is then built without it.
unknown() { comm -23 <(xargs -n1 <<<"$missing" | sort) <(apt-cache pkgnames | sort); }
[ -z "$(unknown)" ] || "${as_root[@]}" apt-get update -q >&2
absent=$(unknown | xargs)
if [ -n "$absent" ]; then
  echo "this system does not have: $absent" >&2
  missing=$(comm -23 <(xargs -n1 <<<"$missing" | sort) <(xargs -n1 <<<"$absent" | sort) | xargs)
fi

# Highway of Ubuntu 22.04 is too old. That of Debian 12 needs nothing that Ubuntu does not have.
if [[ " $missing " == *" libhwy-dev "* && $(dpkg --print-architecture) == amd64 &&
      $(apt-cache policy libhwy-dev) == *"Candidate: 0."* ]]; then
  "${as_root[@]}" apt-get install -y -q --no-install-recommends curl ca-certificates >&2
  folder=$(mktemp -d) && trap 'rm -rf "$folder"' EXIT && chmod 755 "$folder"
  cd "$folder"
  for name in libhwy1 libhwy-dev; do
    curl -fsSO "http://deb.debian.org/debian/pool/main/h/highway/${name}_1.0.3-3+deb12u1_amd64.deb"
  done
  sha256sum --check --quiet >&2 <<'END'
58db3098074f192d32784cf2d070f82d4e26b10d54bc723830a6b9a43be5013b  libhwy1_1.0.3-3+deb12u1_amd64.deb
7db65cd6c5b43b523136f92589ce373f625ca10d569bd0201b5a0d521d8fae4d  libhwy-dev_1.0.3-3+deb12u1_amd64.deb
END
  missing="${missing/libhwy-dev/} $(echo "$folder"/*.deb)"
fi

echo "installing: $missing" >&2
install() {
  "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
    apt-get install -y -q --no-install-recommends $missing >&2
}
if ! install; then
  "${as_root[@]}" apt-get update -q >&2
  install
fi

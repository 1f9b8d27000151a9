#!/usr/bin/env bash
# Usage: install_packages.sh [engine|demo|program]
set -euo pipefail

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
case "${1:-all}" in
  all) list=$(cat "$here/packages.txt") ;;
  engine | demo | program) list=$(sed "/^# --- $1 ends here/,\$d" "$here/packages.txt") ;;
  *) echo "usage: $0 [engine|demo|program]" >&2; exit 2 ;;
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
  if ! sudo -n true 2>/dev/null; then
    echo "packages are missing; install them as root:" >&2
    echo "  sudo apt-get install --no-install-recommends $missing" >&2
    exit 1
  fi
  as_root=(sudo -n)
fi

echo "installing: $missing" >&2
install() {
  "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
    apt-get install -y -q --no-install-recommends $missing >&2
}
# A failure may come from absent or stale package lists.
if ! install; then
  "${as_root[@]}" apt-get update -q >&2
  install
fi

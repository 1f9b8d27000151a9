#!/usr/bin/env bash
# chroot.sh FOLDER: installs the packages of FOLDER in a minimal Debian 12, and uses the program there.
# Needs root, mmdebstrap and Debian's servers; exit code 77 if one is missing.
set -euo pipefail
packages=$(realpath "$1")
skip() {
  echo "skipped: $*"
  exit 77
}
[ "$(id -u)" -eq 0 ] || skip "a chroot needs root"
command -v mmdebstrap >/dev/null || skip "mmdebstrap is not installed (apt-get install mmdebstrap)"
timeout 20 bash -c 'exec 3<>/dev/tcp/deb.debian.org/80' 2>/dev/null || skip "deb.debian.org does not answer"

# Uses memory if there is enough: 40 s instead of several minutes on a busy disk.
[ "$(df --output=avail -k /dev/shm 2>/dev/null | tail -1)" -gt 4000000 ] && export TMPDIR=/dev/shm
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
chmod 755 "$scratch"
cat >"$scratch/use.sh" <<'USE'
set -eux
export HOME=/tmp MANWIDTH=100
test "$(revisit --version | sed -n 1p)" = "revisit $1"
revisit doctor
cd /tmp
revisit simulate -q -o drive --frames 0-60 --every 10
test "$(revisit loops drive --all --quiet --exclusion frames=20 | wc -l)" -eq 8
revisit --version | grep PCL
test "$(revisit loops drive --all --quiet --exclusion none --warmup 3 | cut -d, -f13 | grep -c .)" -ge 2  # x
man revisit | grep -q 'revisit-loops(1)'
man revisit-net-inspect | grep -q -e '--input-shape'
bash -c '. /usr/share/bash-completion/completions/revisit
  COMP_WORDS=(revisit loo) COMP_CWORD=1; _revisit; test "${COMPREPLY[*]}" = loops'
apt-get remove -qq -y revisit >/dev/null
test ! -e /usr/bin/revisit -a ! -e /usr/share/doc/revisit
USE
version=$(dpkg-deb --field "$packages"/revisit_*.deb Version)
mmdebstrap --quiet --variant=minbase --format=null --include=man-db \
  --aptopt='Apt::Install-Recommends "false"' --dpkgopt=force-unsafe-io \
  --customize-hook="copy-in $scratch/use.sh $(echo "$packages"/revisit_*.deb) /tmp" \
  --customize-hook='chroot "$1" sh -c "apt-get install -qq -y /tmp/revisit_*.deb >/dev/null"' \
  --customize-hook="chroot \"\$1\" sh /tmp/use.sh ${version%-*}" \
  bookworm -

#!/usr/bin/env bash
# Follows lines of a page on a clean Debian or Ubuntu, and prints what each took. Needs root and debootstrap.
#
#   packaging/clean_system.sh SUITE FOLDER [FILE]
#
# SUITE   bookworm (Debian 12), jammy or noble (Ubuntu 22.04 and 24.04)
# FOLDER  the system; made if it is not there, with the last commit of this clone in /root/revisit. Delete it afterwards.
# FILE    lines to follow (- for standard input). Default: README's installation; a new shell then uses what it gave.
#
# KEYRING names the keys of Ubuntu's archive for debootstrap. Without them Debian does not check Ubuntu's signatures.
set -euo pipefail
[ $# -ge 2 ] || { sed -n '2,10s/^# \?//p' "$0" >&2; exit 2; }
suite=$1 root=$(realpath -m "$2") file=${3:-}
[ -z "$file" ] || [ "$file" = - ] || file=$(realpath "$file")
cd "$(dirname "$0")/.."
case $suite in
  jammy | noble)  # Debian's debootstrap does not know noble, which is made like all Ubuntus since gutsy
    mirror="http://archive.ubuntu.com/ubuntu /usr/share/debootstrap/scripts/gutsy" components=main,universe ;;
  *) mirror=http://deb.debian.org/debian components=main ;;
esac

follow() {  # each line of standard input by one shell of the system, timed
  unshare -m -p -f bash -euc '
    mount -t proc proc "$0/proc" && mount --rbind /dev "$0/dev"
    exec chroot "$0" env -i PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LANG=C.UTF-8 \
      TIMEFORMAT="   %0R s, %0U s of CPU" ${PIP_CERT:+PIP_CERT=/root/certificates} bash -euc "
        cd /root/revisit
        while IFS= read -r line <&3; do
          case \$line in \"\" | \#*) continue ;; esac
          printf \"+ %s\n\" \"\$line\"
          time eval \"\$line\"
        done" 3<&0 </dev/null' "$root"
}

if [ ! -d "$root" ]; then
  debootstrap --variant=minbase --components=$components ${KEYRING:+--keyring="$KEYRING"} "$suite" "$root" $mirror >"$root.log" ||
    { tail -3 "$root.log" >&2; rm -rf --one-file-system "$root"; exit 1; }
  umount "$root/proc" "$root/sys" 2>/dev/null || true
  [ -z "${PIP_CERT:-}" ] || cp "$PIP_CERT" "$root/root/certificates"
  git archive --prefix=root/revisit/ HEAD | tar -x -C "$root"
fi
cp /etc/resolv.conf "$root/etc/resolv.conf"
if [ -n "$file" ]; then
  follow < <(cat "$file")
  exit
fi
sed -n '/^## Install/,/^```$/p' README.md | sed '1,/^```sh/d; /^```$/d' | follow
follow <<'END'
source venv/bin/activate
revisit --version
python -c "import revisit, revisit.dnn; print(revisit.__version__, revisit.dnn.readNetFromCaffe)"
revisit simulate -o /root/town --route both --length 400 --every 8 --quiet
revisit loops /root/town -q -o /root/loops.csv && test $(wc -l </root/loops.csv) -gt 30
END

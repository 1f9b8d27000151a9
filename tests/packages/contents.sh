#!/usr/bin/env bash
# contents.sh FOLDER: checks the two packages in it, and runs the program from its unpacked package.
set -euo pipefail
cd "$1"
rm -rf root && mkdir root
program=$(echo revisit_*.deb) development=$(echo librevisit-dev_*.deb)

fail() { echo "$*" >&2; exit 1; }
field() { dpkg-deb --field "$1" "$2"; }

# Expects every given file in $1.
holds() {
  local package=$1 file
  shift
  dpkg-deb --contents "$package" | awk '{print $6}' >list
  for file; do grep -qE "^\./usr/$file$" list || fail "$package has no $file"; done
}
holds "$program" bin/revisit share/doc/revisit/{copyright,README.md,docs/reference/FORMATS.md,changelog.gz,changelog.Debian.gz} \
  share/man/man1/revisit{,-loops,-map-build,-net-inspect}.1.gz share/bash-completion/completions/revisit
grep -q '\.a$\|/include/' list && fail "$program has files to compile with"
arch=$(dpkg-architecture -qDEB_HOST_MULTIARCH 2>/dev/null || gcc -print-multiarch)
holds "$development" include/revisit/{engine/net,recognition/range_image,maps/map}.h "lib/$arch/librevisit_(base|proto|engine|recognition).a" \
  "lib/$arch/cmake/revisit/revisitConfig(Version)?.cmake" "lib/$arch/pkgconfig/revisit-(engine|recognition).pc" \
  share/doc/librevisit-dev/copyright
grep -q 'bin/\|man1' list && fail "$development has programs"
dpkg-deb --extract "$program" root
dpkg-deb --extract "$development" root

# The program's package depends on the libraries that it links.
for library in libc6 libopenblas0 libprotobuf libsqlite3-0 libembree3; do
  field "$program" Depends | tr ',' '\n' | grep -q "^ *$library" || fail "$program does not depend on $library"
done
# The development package depends on the packages of libraries that ours link.
{ field "$development" Depends && field "$development" Recommends; } | tr ',' '\n' | sed 's/^ *//; s/ .*//' | sort -u >asked
n_libraries=0
asks_for() {
  local owner
  owner=$(dpkg-query --search "$1" | sed 's/:.*//') || fail "no package has $1"
  grep -qx "$owner" asked || fail "$development asks for no $owner, which has $1"
  n_libraries=$((n_libraries + 1))
}
# CMake targets name libraries by file, .pc files by flag.
while read -r file; do
  asks_for "$(realpath -s "$file")"
done < <(grep -h 'INTERFACE_LINK_LIBRARIES "' root/usr/lib/"$arch"/cmake/revisit/*.cmake | tr ';":>' '\n' | grep '^/' | sort -u)
while read -r flag; do
  case $flag in -lpthread | -lopenblas) continue ;; esac # glibc's; an alternative, which no package owns
  for file in "lib${flag#-l}."{so,a}; do
    found=$(realpath -s "$(gcc -print-file-name="$file")")
    [ ! -e "$found" ] || break
  done
  case $found in */gcc/*) continue ;; esac # the compiler's own
  asks_for "$found"
done < <(sed -n 's/^Libs.private: //p' root/usr/lib/"$arch"/pkgconfig/*.pc | xargs -n1 | grep '^-l' | sort -u)
[ "$n_libraries" -gt 10 ] || fail "only $n_libraries libraries were looked at"

home=$PWD/home
rm -rf home drive && mkdir home
revisit() { env -i HOME="$home" PATH=/usr/bin:/bin "$PWD/root/usr/bin/revisit" "$@"; }
version=$(field "$program" Version)
[ "$(revisit --version | sed -n 1p)" = "revisit ${version%-*}" ] || fail "the program is of another version than $version"
revisit doctor >doctor || { cat doctor; fail "revisit doctor: exit code $?"; }
revisit simulate -q -o drive --frames 0-60 --every 10
[ "$(revisit loops drive --all --quiet --exclusion frames=20 | wc -l)" -eq 8 ] || fail "revisit loops says nothing"
if command -v man >/dev/null; then
  MANWIDTH=100 man --warnings -l root/usr/share/man/man1/revisit.1.gz >page 2>said
  [ ! -s said ] || { cat said; fail "the manual page has faults"; }
  grep -q 'revisit-loops(1)' page || fail "the manual page does not list the commands"
fi
rm -rf root home drive
echo "$program, $development: $n_libraries libraries are asked for"

#!/usr/bin/env bash
# manual.sh PROGRAM FOLDER: makes a manual page of each command of `revisit` from its --help, by help2man.
set -euo pipefail
program=$1 folder=$2 here=$(dirname "${BASH_SOURCE[0]}")
version=$("$program" --version | sed -n '1s/.* //p')
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
mkdir -p "$folder"

# page "NAME" COMMAND...: the pages of a command and of those in its list.
page() {
  local headline=$1 name below headline_below
  shift
  name=$(IFS=- && echo "revisit${*:+-$*}")
  printf '#!/bin/sh\nexec "%s" %s "$@"\n' "$program" "$*" >"$scratch/$name" && chmod +x "$scratch/$name"
  "$scratch/$name" --help | sed -n '/^Usage: .* COMMAND /,$s/^  \([a-z-]\+\)  *\(.*\)/\1 \2/p' >"$scratch/$name.below"
  { [ $# -eq 0 ] || echo 'revisit(1)'
    sed "s/^\([^ ]*\) .*/$name-\1(1)/" "$scratch/$name.below"
  } | sed 's/-/\\-/g; $!s/$/,/; 1i [see also]\n.nh' >"$scratch/$name.h2m"
  [ $# -ne 0 ] || cat "$here/environment.h2m" >>"$scratch/$name.h2m"
  help2man --no-info --help-option=--help=all --version-string="$version" --name="$headline" --include="$scratch/$name.h2m" \
    --source="revisit $version" "$scratch/$name" |
    sed '/^\.SH EXAMPLES/,/^\.SH "SEE ALSO"/ { s/^\.IP$/.PP\n.nf/; s/^\.SH "SEE/.fi\n&/ }' >"$folder/$name.1" # lines stay lines
  while read -r below headline_below; do
    page "$headline_below" "$@" "$below"
  done <"$scratch/$name.below"
}
page 'loop closure detection for LiDAR SLAM, and original Caffe networks, on the CPU'

#!/usr/bin/env bash
# Every name of the public headers has a comment that Doxygen shows. Exit code 77 without doxygen.
set -euo pipefail
cd "$(dirname "$0")/../.."
command -v doxygen >/dev/null || { echo "skipped: doxygen is missing"; exit 77; }
out=$(mktemp -d)
trap 'rm -r "$out"' EXIT
{
  cat packaging/site/Doxyfile
  printf '%s\n' "OUTPUT_DIRECTORY=$out" "WARN_LOGFILE=$out/log" GENERATE_HTML=NO GENERATE_XML=YES XML_PROGRAMLISTING=NO
} | doxygen -
! grep . "$out/log"

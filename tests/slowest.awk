# Passes the output of ctest on, and prints the ten slowest tests before its summary.
/ Test +#[0-9]+: .* sec$/ {
  name = $0
  sub(/^.* Test +#[0-9]+: /, "", name)
  sub(/ .*/, "", name)
  seconds[name] = $(NF - 1)
}
/^[0-9]+% tests passed/ {
  print "The slowest tests [s]:"
  for (place = 1; place <= 10; ++place) {
    slowest = ""
    for (name in seconds)
      if (slowest == "" || seconds[name] + 0 > seconds[slowest] + 0) slowest = name
    if (slowest == "") break
    printf "%9.1f  %s\n", seconds[slowest], slowest
    delete seconds[slowest]
  }
  print ""
}
{ print; fflush() }

#include "cli/terminal.h"
#include "testing.h"

namespace revisit::cli {
namespace {

/// Exits with 7 if the second signal does not end it, with 8 if the first one is not noticed.
void get_signals(int first, int second) {
  watch_for_interrupt();
  std::raise(first);
  if (!interrupted()) std::_Exit(8);
  std::raise(second);
  std::_Exit(7);
}

TEST(Interrupt, TheSecondSignalEndsTheProgramWhicheverItIs) {
  for (const int first : {SIGINT, SIGTERM})
    for (const int second : {SIGINT, SIGTERM})
      EXPECT_EXIT(get_signals(first, second), testing::KilledBySignal(second), "")
          << first << " " << second;
}

}  // namespace
}  // namespace revisit::cli

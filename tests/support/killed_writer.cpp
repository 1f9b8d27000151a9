#include "killed_writer.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <exception>

namespace revisit::test {

int64_t last_before_kill(const std::function<void(int pipe)>& write, int answers, int microseconds,
                         int64_t before) {
  int ends[2];
  if (::pipe(ends) != 0) {
    ADD_FAILURE() << "no pipe";
    return before;
  }
  const pid_t child = ::fork();
  if (child == 0) {
    try {
      write(ends[1]);
    } catch (const std::exception& error) {
      std::fprintf(stderr, "%s\n", error.what());
    }
    std::_Exit(1);
  }
  ::close(ends[1]);
  int64_t last = before, number = 0;
  const auto answered = [&] { return ::read(ends[0], &number, sizeof(number)) == sizeof(number); };
  for (; answers > 0; --answers)
    if (answered()) last = number;
  ::usleep(static_cast<useconds_t>(microseconds));
  ::kill(child, SIGKILL);
  while (answered()) last = number;
  ::close(ends[0]);
  int status = 0;
  ::waitpid(child, &status, 0);
  EXPECT_TRUE(WIFSIGNALED(status)) << "the writer ended by itself";
  return last;
}

}  // namespace revisit::test

#include "process.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <exception>

namespace revisit::test {

Process::Process(const std::function<void()>& work) {
  std::fflush(stdout);
  id_ = ::fork();
  if (id_ != 0) return;
  try {
    work();
  } catch (const std::exception& error) {
    ADD_FAILURE() << error.what();
  }
  std::fflush(stdout);
  std::_Exit(::testing::Test::HasFailure() ? 1 : 0);
}

Process::~Process() {
  if (id_ <= 0) return;
  ::kill(id_, SIGKILL);
  wait();
}

int Process::wait() {
  int status = 0;
  ::waitpid(id_, &status, 0);
  id_ = -1;
  return status;
}

void Process::kill() {
  ::kill(id_, SIGKILL);
  EXPECT_TRUE(WIFSIGNALED(wait())) << "the process ended by itself";
}

bool Process::succeeds() {
  const int status = wait();
  return WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

}  // namespace revisit::test

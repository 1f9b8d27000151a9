#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <new>
#include <optional>
#include <string>

#include "cli/command.h"
#include "cli/interrupt.h"
#include "cli/messages.h"
#include "cli/printable.h"
#include "revisit/base/error.h"
#include "revisit/engine/blas.h"

namespace {

using namespace revisit;

int fail(const std::string& message, int code) {
  std::cerr << "revisit: " << message << "\n";
  return code;
}

/// Starts the program again with OPENBLAS_CORETYPE set when OpenBLAS did not recognise the CPU and
/// fell back to kernels far below it. Goes on when the user set the variable, or exec fails.
void restart_with_faster_blas(char** argv) {
  constexpr const char* kVariable = "OPENBLAS_CORETYPE";  // read when the library is loaded
  if (std::getenv(kVariable)) return;
  const std::string core = engine::faster_blas_core();
  if (core.empty() || setenv(kVariable, core.c_str(), 1) != 0) return;
  execv("/proc/self/exe", argv);
}

/// Ends before the exit handlers of libraries: OpenBLAS's waits for its threads, and these for
/// memory, without end where there is none (`ulimit -v`).
[[maybe_unused]] void end_at_once(int code, void* /*unused*/) {
  std::fflush(nullptr);
  std::_Exit(code);
}

}  // namespace

int main(int argc, char** argv) {
  restart_with_faster_blas(argv);
#ifndef __SANITIZE_ADDRESS__  // it looks for leaks at the end
  on_exit(end_at_once, nullptr);
#endif
  cli::watch_for_interrupt();
  std::signal(SIGXFSZ, SIG_IGN);  // a file too large for `ulimit -f` is an error of the write
  // Names in files are not to command the terminal.
  const cli::PrintableStream messages(std::cerr);
  std::optional<cli::PrintableStream> output;
  if (isatty(STDOUT_FILENO)) output.emplace(std::cout);
  try {
    const int code = cli::revisit_command({argv + 1, argv + argc});
    std::cout.flush();
    return std::cout ? code : fail("cannot write to standard output", cli::kFailed);
  } catch (const UsageError& error) {
    return fail(cli::message_of(error), cli::kUsage);
  } catch (const InputError& error) {
    return fail(cli::message_of(error), cli::kBadInput);
  } catch (const UnsupportedError& error) {
    return fail(cli::message_of(error), cli::kUnsupported);
  } catch (const Interrupted& error) {
    return fail(cli::message_of(error), cli::kInterrupted);
  } catch (const Error& error) {
    return fail(cli::message_of(error), cli::kFailed);
  } catch (const std::bad_alloc&) {
    return fail("out of memory; try a smaller input or fewer threads", cli::kFailed);
  } catch (const std::exception& error) {
    return fail(error.what(), cli::kFailed);
  }
}

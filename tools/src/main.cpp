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
#include "revisit/engine/machine.h"

namespace {

using namespace revisit;

int fail(const std::string& message, int code) {
  std::cerr << "revisit: " << message << "\n";
  return code;
}

/// Restarts the program with OPENBLAS_CORETYPE if OpenBLAS did not recognize the CPU and chose slow
/// kernels. Returns if the user set the variable or exec fails.
void restart_with_faster_blas(char** argv) {
  constexpr const char* kVariable = "OPENBLAS_CORETYPE";  // read when the library is loaded
  if (std::getenv(kVariable)) return;
  const std::string core = engine::faster_blas_core();
  if (core.empty() || setenv(kVariable, core.c_str(), 1) != 0) return;
  execv("/proc/self/exe", argv);
}

/// Ends the process before the exit handlers of libraries, because OpenBLAS's may wait forever for
/// threads that wait for memory (`ulimit -v`).
[[maybe_unused]] void end_at_once(int code, void* /*unused*/) {
  std::fflush(nullptr);
  std::_Exit(code);
}

}  // namespace

int main(int argc, char** argv) {
  restart_with_faster_blas(argv);
#ifndef __SANITIZE_ADDRESS__  // it checks for leaks at exit
  on_exit(end_at_once, nullptr);
#endif
  cli::watch_for_interrupt();
  std::signal(SIGXFSZ, SIG_IGN);  // a file beyond `ulimit -f` becomes a write error
  // Names from files must not send commands to the terminal.
  const cli::PrintableStream messages(std::cerr);
  std::optional<cli::PrintableStream> output;
  if (isatty(STDOUT_FILENO)) output.emplace(std::cout);
  try {
    const int code = cli::run_revisit({argv + 1, argv + argc});
    std::cout.flush();
    return std::cout ? code : fail("cannot write to standard output", cli::kFailed);
  } catch (const UsageError& error) {
    return fail(error.what(), cli::kUsage);
  } catch (const InputError& error) {
    return fail(error.what(), cli::kBadInput);
  } catch (const UnsupportedError& error) {
    return fail(error.what(), cli::kUnsupported);
  } catch (const Interrupted& error) {
    return fail(error.what(), cli::kInterrupted);
  } catch (const Error& error) {
    return fail(error.what(), cli::kFailed);
  } catch (const std::bad_alloc&) {
    return fail("out of memory; give a smaller input or fewer threads", cli::kFailed);
  } catch (const std::exception& error) {
    return fail(error.what(), cli::kFailed);
  }
}

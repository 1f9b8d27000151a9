#include "cli/main.h"

#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <new>
#include <optional>

#include "cli/interrupt.h"
#include "cli/printable.h"
#include "revisit/base/error.h"

namespace revisit::cli {
namespace {

/// Ends the process before the exit handlers of libraries, because OpenBLAS's may wait forever for
/// threads that wait for memory (`ulimit -v`).
[[maybe_unused]] void end_at_once(int code, void* /*unused*/) {
  std::fflush(nullptr);
  std::_Exit(code);
}

}  // namespace

int run_main(const std::string& program, int argc, char** argv,
             const std::function<int(const Arguments&)>& run) {
#ifndef __SANITIZE_ADDRESS__  // it checks for leaks at exit
  on_exit(end_at_once, nullptr);
#endif
  watch_for_interrupt();
  std::signal(SIGXFSZ, SIG_IGN);  // a file beyond `ulimit -f` becomes a write error
  // Names from files must not send commands to the terminal.
  const PrintableStream messages(std::cerr);
  std::optional<PrintableStream> output;
  if (isatty(STDOUT_FILENO)) output.emplace(std::cout);
  const auto fail = [&](const std::string& message, int code) {
    std::cerr << program << ": " << message << "\n";
    return code;
  };
  try {
    const int code = run({argv + 1, argv + argc});
    std::cout.flush();
    return std::cout ? code : fail("cannot write to standard output", kFailed);
  } catch (const UsageError& error) {
    return fail(error.what(), kUsage);
  } catch (const InputError& error) {
    return fail(error.what(), kBadInput);
  } catch (const UnsupportedError& error) {
    return fail(error.what(), kUnsupported);
  } catch (const Interrupted& error) {
    return fail(error.what(), kInterrupted);
  } catch (const Error& error) {
    return fail(error.what(), kFailed);
  } catch (const std::bad_alloc&) {
    return fail("out of memory; give a smaller input or fewer threads", kFailed);
  } catch (const std::exception& error) {
    return fail(error.what(), kFailed);
  }
}

}  // namespace revisit::cli

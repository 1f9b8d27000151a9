#include <unistd.h>

#include <cstdlib>
#include <string>

#include "cli/command.h"
#include "revisit/engine/machine.h"

namespace {

/// Restarts the program with OPENBLAS_CORETYPE if OpenBLAS did not recognize the CPU and chose slow
/// kernels. Returns if the user set the variable or exec fails.
void restart_with_faster_blas(char** argv) {
  constexpr const char* kVariable = "OPENBLAS_CORETYPE";  // read when the library is loaded
  if (std::getenv(kVariable)) return;
  const std::string core = revisit::engine::faster_blas_core();
  if (core.empty() || setenv(kVariable, core.c_str(), 1) != 0) return;
  execv("/proc/self/exe", argv);
}

}  // namespace

int main(int argc, char** argv) {
  restart_with_faster_blas(argv);
  return revisit::cli::run_main("revisit", argc, argv, revisit::cli::run_revisit);
}

#include "blas_choice.h"

#include <unistd.h>

#include <cstdlib>
#include <string>

#include "revisit/engine/blas.h"

namespace revisit::cli {

void restart_with_faster_blas(char** argv) {
  constexpr const char* kVariable = "OPENBLAS_CORETYPE";  // read when the library is loaded
  if (std::getenv(kVariable)) return;
  const std::string core = engine::faster_blas_core();
  if (core.empty() || setenv(kVariable, core.c_str(), 1) != 0) return;
  execv("/proc/self/exe", argv);
}

}  // namespace revisit::cli

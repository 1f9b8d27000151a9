#include "doctor/openblas.h"

// From OpenBLAS' cblas.h, which only the engine includes.
extern "C" char* openblas_get_config(void);

namespace revisit::doctor {

std::string openblas_configuration() {
  std::string text = openblas_get_config();
  while (!text.empty() && text.back() == ' ') text.pop_back();
  return text;
}

}  // namespace revisit::doctor

#include "weights_case.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  revisit::fuzz::read_weights(revisit::fuzz::text(data, size));
  return 0;
}

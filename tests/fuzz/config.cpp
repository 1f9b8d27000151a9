#include "eval/eval_options.h"
#include "fuzz.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace revisit;
  const fuzz::InputFile file(fuzz::text(data, size));
  fuzz::works_or_refuses([&] { cli::read_config_file(file.path()); });
  return 0;
}

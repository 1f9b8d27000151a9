// What `revisit loops --format jsonl` writes, as `revisit report` reads it.
#include "page_case.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const revisit::fuzz::InputFile file(revisit::fuzz::text(data, size));
  revisit::fuzz::make_page(file.path());
  return 0;
}

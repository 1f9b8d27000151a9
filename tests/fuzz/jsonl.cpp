// Output of `revisit loops --format jsonl`, as read by `revisit report`.
#include "page_case.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const revisit::fuzz::InputFile file(revisit::fuzz::text(data, size));
  revisit::fuzz::make_page(file.path());
  return 0;
}

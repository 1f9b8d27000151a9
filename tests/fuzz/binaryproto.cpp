#include "fuzz.h"
#include "revisit/proto/weights_file.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace revisit;
  const fuzz::InputFile file(fuzz::text(data, size));
  fuzz::works_or_refuses([&] { proto::read_binaryproto(file.path()); });
  return 0;
}

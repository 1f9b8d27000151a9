#include "fuzz.h"
#include "mutator.h"

extern "C" size_t LLVMFuzzerMutate(uint8_t* data, size_t size, size_t max_size);

extern "C" size_t LLVMFuzzerCustomMutator(uint8_t* data, size_t size, size_t max_size,
                                          unsigned int seed) {
  revisit::fuzz::Random random(seed);
  if (random.below(2) == 0) return LLVMFuzzerMutate(data, size, max_size);
  std::string bytes = revisit::fuzz::text(data, size);
  revisit::fuzz::mutate_structure(bytes, bytes, max_size, random);
  std::copy(bytes.begin(), bytes.end(), data);
  return bytes.size();
}

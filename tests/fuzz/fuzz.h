#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>

#include "revisit/base/error.h"

/// Called by libFuzzer or standalone_main.cpp for every case.
extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size);

namespace revisit::fuzz {

/// Counts cases in which works_or_refuses() caught one of our errors and cases without, because a
/// target that rejects nearly everything tests little.
inline uint64_t rejections = 0, successes = 0;

/// Contract of all functions that take input: they succeed or throw one of our own errors. Any
/// other exception leaves the target and ends the program: a finding.
template <class Work>
void works_or_refuses(const Work& work) {
  const uint64_t before = rejections + successes;
  try {
    work();
    if (rejections + successes == before) ++successes;
  } catch (const Error&) {
    ++rejections;
  }
}

inline void require(bool holds, const char* property) {
  if (holds) return;
  std::fprintf(stderr, "violated: %s\n", property);
  std::abort();
}

/// Case as an in-memory file.
class InputFile {
 public:
  /// `extension` is for readers that depend on it, e.g. ".bin".
  explicit InputFile(const std::string& bytes, const std::string& extension = "");
  ~InputFile();
  InputFile(const InputFile&) = delete;
  InputFile& operator=(const InputFile&) = delete;

  const std::filesystem::path& path() const { return path_; }

 private:
  int descriptor_ = -1;
  bool is_link_ = false;
  std::filesystem::path path_;
};

inline std::string text(const uint8_t* data, size_t size) {
  return {reinterpret_cast<const char*>(data), size};
}

}  // namespace revisit::fuzz

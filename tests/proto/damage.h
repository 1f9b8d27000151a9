#pragma once

#include <filesystem>
#include <fstream>

namespace revisit::test {

/// Works in place, because writing the file again is much slower.
inline void patch_file(const std::filesystem::path& file, size_t at, char byte) {
  std::fstream out(file, std::ios::binary | std::ios::in | std::ios::out);
  out.seekp(static_cast<std::streamoff>(at));
  out.put(byte);
}

}  // namespace revisit::test

#include "revisit/base/file_content.h"

#include <algorithm>
#include <limits>

#include "revisit/base/error.h"
#include "revisit/base/file_cursor.h"

namespace revisit {

std::string read_head(const std::filesystem::path& file, size_t most) {
  FileCursor cursor(file);
  std::string head(std::min<uint64_t>(most, cursor.size()), '\0');
  cursor.read(head.data(), head.size());
  return head;
}

std::string read_content(const std::filesystem::path& file) {
  return read_head(file, std::numeric_limits<size_t>::max());
}

std::string content_if_any(const std::filesystem::path& file) {
  try {
    return read_content(file);
  } catch (const InputError&) {
    return "";
  }
}

}  // namespace revisit

#include "revisit/proto/shape_text.h"

namespace revisit::proto {

std::string shape_text(std::span<const int64_t> shape) {
  std::string text;
  for (const int64_t size : shape) text += (text.empty() ? "" : "x") + std::to_string(size);
  return text.empty() ? "()" : text;
}

}  // namespace revisit::proto

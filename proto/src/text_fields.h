#pragma once

#include <cstddef>
#include <optional>
#include <string_view>
#include <vector>

namespace revisit::proto {

/// Field in protobuf's text format. Positions are byte offsets.
struct TextField {
  std::string_view name;
  size_t begin = 0, end = 0;  // from its name to the end of its value
  size_t value = 0;           // start of its value
  char opens = 0;  // first character of the value: '{' or '<' for a message, '[' for a list
};

/// Parses the message body text[begin, end); nullopt if it is malformed or nests too deeply.
std::optional<std::vector<TextField>> text_fields(std::string_view text, size_t begin, size_t end);

}  // namespace revisit::proto

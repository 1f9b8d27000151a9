#pragma once

#include <cstddef>
#include <optional>
#include <string_view>
#include <vector>

namespace revisit::proto {

/// A field of a message in protobuf's text format. Positions are byte offsets in the text.
struct TextField {
  std::string_view name;
  size_t begin = 0, end = 0;  // from its name to the end of its value
  size_t value = 0;           // start of its value
  char opens = 0;  // first character of the value: '{' or '<' for a message, '[' for a list
};

/// Returns the fields of the message with the body text[begin, end), with any names. Returns
/// nullopt if the text has no fields, e.g. for braces that do not match or nest too deeply.
std::optional<std::vector<TextField>> text_fields(std::string_view text, size_t begin, size_t end);

}  // namespace revisit::proto

#pragma once

#include <cstddef>
#include <optional>
#include <string_view>
#include <vector>

namespace revisit::proto {

/// A field of a message in protobuf's text format. Positions are bytes from the text's begin.
struct TextField {
  std::string_view name;
  size_t begin = 0, end = 0;  // from its name to behind its value
  size_t value = 0;           // where its value begins
  char opens = 0;  // what the value begins with: '{' and '<' for a message, '[' for a list
};

/// The fields of the message whose inside is text[begin, end), whatever they are called. Nothing
/// for a text that has no fields, e.g. one whose braces do not match or nest too deeply.
std::optional<std::vector<TextField>> text_fields(std::string_view text, size_t begin, size_t end);

}  // namespace revisit::proto

#pragma once

#include <string>
#include <vector>

#include "caffe_schema.pb.h"
#include "revisit/proto/net_file.h"

namespace revisit::proto {

/// Where in a text, both from 1; the column counts bytes. Line 0: nowhere in particular.
struct TextPosition {
  int line = 0, column = 0;
};

/// `name:line:column: ` or `name: `, to begin a message with.
std::string message_start(const std::string& name, TextPosition position);

/// Parses prototxt text as it stands, without upgrading. Throws InputError with the position.
/// Unknown fields are errors or, if allowed, warnings.
caffe::NetParameter parse_net_text(const std::string& text, const std::string& name,
                                   const NetReadOptions& options,
                                   std::vector<std::string>& warnings);

/// Where entry `index` of NetParameter's `field` stands in a text that parses.
TextPosition locate(const std::string& text, const std::string& field, int index);

}  // namespace revisit::proto

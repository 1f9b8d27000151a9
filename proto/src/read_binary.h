#pragma once

#include <string>
#include <vector>

#include "revisit/proto/net_file.h"

namespace revisit::proto {

/// Parses a binary net. Skips fields of layers that do not parse, with a warning, because forks
/// give the same numbers to different fields. Returns false for other bytes.
bool parse_binary(const std::string& bytes, caffe::NetParameter& net,
                  std::vector<std::string>& warnings);

}  // namespace revisit::proto

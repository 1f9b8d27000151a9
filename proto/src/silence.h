#pragma once

#include <google/protobuf/io/tokenizer.h>

#include <string>

namespace revisit::proto {

/// For a text that need not parse: without it, protobuf would log each complaint.
class Silence final : public google::protobuf::io::ErrorCollector {
  void AddError(int, google::protobuf::io::ColumnNumber, const std::string&) override {}
};

}  // namespace revisit::proto

#pragma once

#include <google/protobuf/io/tokenizer.h>

#include <string>

namespace revisit::proto {

/// Discards errors, which protobuf would log otherwise.
class Silence final : public google::protobuf::io::ErrorCollector {
  void AddError(int, google::protobuf::io::ColumnNumber, const std::string&) override {}
};

}  // namespace revisit::proto

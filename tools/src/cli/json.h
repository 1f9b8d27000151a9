#pragma once

#include <google/protobuf/message.h>

#include <string>

namespace revisit::cli {

/// A report as indented JSON with the field names of reports.proto. Unset optional fields are left
/// out. The writer is protobuf's own.
std::string to_json(const google::protobuf::Message& report);

}  // namespace revisit::cli

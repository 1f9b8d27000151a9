#include "json.h"

#include <google/protobuf/util/json_util.h>

#include "revisit/proto/error.h"

namespace revisit::cli {

std::string to_json(const google::protobuf::Message& report) {
  google::protobuf::util::JsonPrintOptions options;
  options.add_whitespace = true;
  options.always_print_primitive_fields = true;
  options.preserve_proto_field_names = true;
  std::string text;
  const auto status = google::protobuf::util::MessageToJsonString(report, &text, options);
  if (!status.ok()) throw Error("cannot write JSON: " + status.ToString());
  return text;
}

}  // namespace revisit::cli

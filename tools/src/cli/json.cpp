#include "json.h"

#include <google/protobuf/util/json_util.h>

#include <fstream>
#include <sstream>

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

namespace {

std::string content_of(const std::filesystem::path& file) {
  std::ifstream in(file);
  std::ostringstream content;
  content << in.rdbuf();
  if (!in) throw InputError(file.string() + ": cannot read the file");
  return std::move(content).str();
}

}  // namespace

google::protobuf::Struct read_json(const std::filesystem::path& file) {
  google::protobuf::Value value;
  const auto status = google::protobuf::util::JsonStringToMessage(content_of(file), &value);
  if (!status.ok()) throw InputError(str(file.string(), ": ", status.ToString()));
  if (value.has_struct_value()) return value.struct_value();
  google::protobuf::Struct wrapped;
  (*wrapped.mutable_fields())[""] = value;
  return wrapped;
}

void read_report(const std::filesystem::path& file, google::protobuf::Message* report) {
  google::protobuf::util::JsonParseOptions options;
  options.ignore_unknown_fields = true;
  const auto status =
      google::protobuf::util::JsonStringToMessage(content_of(file), report, options);
  if (!status.ok())
    throw InputError(str(file.string(), ": not the ", report->GetDescriptor()->name(),
                         " that revisit writes: ", status.ToString()));
}

}  // namespace revisit::cli

#include "json.h"

#include <google/protobuf/util/json_util.h>

#include <iostream>
#include <memory>
#include <vector>

#include "cli/terminal.h"
#include "revisit/base/error.h"
#include "revisit/base/files.h"

namespace revisit::cli {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using google::protobuf::util::JsonPrintOptions;

/// JSON is UTF-8. Names of files and drives need not be, and protobuf ends a text where it is not.
void make_utf8(Message* report) {
  const auto* fields = report->GetReflection();
  std::vector<const FieldDescriptor*> set;
  fields->ListFields(*report, &set);
  for (const FieldDescriptor* field : set) {
    const int n = field->is_repeated() ? fields->FieldSize(*report, field) : 1;
    for (int i = 0; i < n; ++i) {
      if (field->cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE)
        make_utf8(field->is_repeated() ? fields->MutableRepeatedMessage(report, field, i)
                                       : fields->MutableMessage(report, field));
      if (field->type() != FieldDescriptor::TYPE_STRING) continue;
      if (field->is_repeated())
        fields->SetRepeatedString(report, field, i,
                                  utf8(fields->GetRepeatedString(*report, field, i)));
      else
        fields->SetString(report, field, utf8(fields->GetString(*report, field)));
    }
  }
}

std::string printed(const Message& given, JsonPrintOptions options) {
  const std::unique_ptr<Message> report(given.New());
  report->CopyFrom(given);
  make_utf8(report.get());
  options.preserve_proto_field_names = true;
  std::string text;
  const auto status = google::protobuf::util::MessageToJsonString(*report, &text, options);
  if (!status.ok()) throw Error("cannot write JSON: " + std::string(status.message()));
  return text;
}

}  // namespace

std::string to_json(const google::protobuf::Message& report) {
  JsonPrintOptions options;
  options.add_whitespace = true;
  options.always_print_primitive_fields = true;
  return printed(report, options);
}

std::string to_compact_json(const google::protobuf::Message& report) {
  return printed(report, {});
}

void write_json(const std::filesystem::path& file, const Message& report) {
  make_folder(file.parent_path());
  write_atomically(file, [&](std::ostream& out) { out << to_json(report) << "\n"; });
}

void print_report(const std::string& format, const google::protobuf::Message& report,
                  const Table& table) {
  if (format == "json")
    std::cout << to_json(report);
  else if (format == "csv")
    table.print_csv(std::cout);
  else
    table.print(std::cout);
}

void read_report(const std::filesystem::path& file, google::protobuf::Message* report) {
  parse_report(read_content(file), file.string(), report);
}

void parse_report(const std::string& text, const std::string& name,
                  google::protobuf::Message* report) {
  google::protobuf::util::JsonParseOptions options;
  options.ignore_unknown_fields = true;
  const auto status = google::protobuf::util::JsonStringToMessage(text, report, options);
  const std::string reason(status.message());
  if (!status.ok())  // protobuf draws the position below the first line
    throw InputError(name, ": not the ", report->GetDescriptor()->name(),
                     " that revisit writes: ", reason.substr(0, reason.find('\n')));
}

}  // namespace revisit::cli

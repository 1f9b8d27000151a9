#pragma once

#include <google/protobuf/message.h>
#include <google/protobuf/struct.pb.h>

#include <filesystem>
#include <string>

namespace revisit::cli {

/// Indented JSON with the field names of reports.proto. Unset optional fields are left out.
std::string to_json(const google::protobuf::Message& report);

/// One line without fields that have their default, and with \u003c for '<': for HTML scripts.
std::string to_compact_json(const google::protobuf::Message& report);

/// Writes to_json() to a file, whole or not at all; makes its folder.
void write_json(const std::filesystem::path& file, const google::protobuf::Message& report);

class Table;

/// Prints a report as `format`, "table", "json" or "csv", says; the table has the same in columns.
void print_report(const std::string& format, const google::protobuf::Message& report,
                  const Table& table);

/// Reads a JSON file. A list at the top is found under the key "". Throws InputError.
google::protobuf::Struct read_json(const std::filesystem::path& file);

/// Reads what to_json() wrote, without unknown fields. Throws InputError.
void read_report(const std::filesystem::path& file, google::protobuf::Message* report);
/// The same of the text itself; `name` begins the error.
void parse_report(const std::string& text, const std::string& name,
                  google::protobuf::Message* report);

}  // namespace revisit::cli

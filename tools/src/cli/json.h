#pragma once

#include <filesystem>
#include <string>

namespace google::protobuf {
class Message;
}

namespace revisit::cli {

class Table;

/// Indented JSON with the field names of reports.proto. Omits unset optional fields.
std::string to_json(const google::protobuf::Message& report);

/// One line for HTML scripts: without fields that have their default, and with \u003c for '<'.
std::string to_compact_json(const google::protobuf::Message& report);

/// Writes to_json() to a file atomically; creates its folder.
void write_json(const std::filesystem::path& file, const google::protobuf::Message& report);

/// Prints a report as "table", "json" or "csv"; `table` holds the same content.
void print_report(const std::string& format, const google::protobuf::Message& report,
                  const Table& table);

/// Reads output of to_json() and ignores unknown fields. Throws InputError.
void read_report(const std::filesystem::path& file, google::protobuf::Message* report);
/// `name` begins the error message.
void parse_report(const std::string& text, const std::string& name,
                  google::protobuf::Message* report);

}  // namespace revisit::cli

#pragma once

#include <google/protobuf/message.h>
#include <google/protobuf/struct.pb.h>

#include <filesystem>
#include <iosfwd>
#include <string>
#include <vector>

namespace revisit::cli {

class Table {
 public:
  explicit Table(std::vector<std::string> header);
  void row(std::vector<std::string> cells);
  /// Pads columns, aligns numbers right, and makes cells printable().
  void print(std::ostream& out) const;
  /// RFC 4180 comma-separated values, header first; the exact bytes.
  void print_csv(std::ostream& out) const;

 private:
  std::vector<std::vector<std::string>> rows_;  // rows_[0] is the header
};

/// "" for NaN (not computed).
std::string number(double value, int digits);

/// Indented JSON with the field names of reports.proto. Omits unset optional fields.
std::string to_json(const google::protobuf::Message& report);

/// One line for HTML scripts: without fields that have their default, and with \u003c for '<'.
std::string to_compact_json(const google::protobuf::Message& report);

/// Writes to_json() to a file atomically; creates its folder.
void write_json(const std::filesystem::path& file, const google::protobuf::Message& report);

/// Prints a report as "table", "json" or "csv"; `table` holds the same content.
void print_report(const std::string& format, const google::protobuf::Message& report,
                  const Table& table);

/// Reads a JSON file. A top-level list has the key "". Throws InputError.
google::protobuf::Struct read_json(const std::filesystem::path& file);

/// Reads output of to_json() and ignores unknown fields. Throws InputError.
void read_report(const std::filesystem::path& file, google::protobuf::Message* report);
/// `name` begins the error message.
void parse_report(const std::string& text, const std::string& name,
                  google::protobuf::Message* report);

/// `format`: of strftime().
std::string local_time(const char* format);

}  // namespace revisit::cli

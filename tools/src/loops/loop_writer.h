#pragma once

#include <reports.pb.h>

#include <iosfwd>
#include <string>

#include "loops/recognize.h"

namespace revisit::cli {

/// A line of JSON, without its end.
std::string json_of(const reports::LoopLine& loop);

reports::LoopLine line_of(const Visit& visit, const std::string& drive);

/// Prints one line per loop without delay: "csv" with a header, or "jsonl". Throws Error with the
/// reason if that fails.
class LoopWriter {
 public:
  LoopWriter(std::ostream& out, const std::string& format);
  void write(const reports::LoopLine& loop);

 private:
  void flush();

  std::ostream& out_;
  bool json_;
};

}  // namespace revisit::cli

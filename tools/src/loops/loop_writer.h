#pragma once

#include <reports.pb.h>

#include <iosfwd>
#include <string>

#include "loops/recognize.h"

namespace revisit::cli {

/// A line of JSON, without its end.
std::string json_of(const reports::LoopLine& loop);

reports::LoopLine line_of(const Visit& visit, const std::string& drive);

/// Prints one line per loop without delay: "csv" with a header, or "jsonl".
class LoopWriter {
 public:
  LoopWriter(std::ostream& out, const std::string& format);
  void write(const reports::LoopLine& loop);

 private:
  std::ostream& out_;
  bool json_;
};

}  // namespace revisit::cli

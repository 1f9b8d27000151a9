#pragma once

#include <map>
#include <string>

#include "reports.pb.h"
#include "revisit/datasets/describe.h"

namespace revisit::cli {

/// Reduced range images as data URIs, with a limit on their total size.
class RangeImages {
 public:
  explicit RangeImages(size_t most_bytes) : most_bytes_(most_bytes) {}

  /// Key of a scan's picture in images(), or "". `turned`: alignment case 2.
  std::string add(const std::string& scan_file, const reports::RunInfo& info, bool turned);

  const std::map<std::string, std::string>& images() const { return images_; }
  /// Reason for missing pictures, or "".
  const std::string& warning() const { return warning_; }

 private:
  size_t most_bytes_, bytes_ = 0;
  std::map<std::string, std::string> images_;  // "case1 4000x112 /data/000123.bin" -> data URI
  std::string warning_;
};

}  // namespace revisit::cli

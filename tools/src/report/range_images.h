#pragma once

#include <map>
#include <string>

#include "reports.pb.h"
#include "revisit/datasets/describe.h"

namespace revisit::cli {

/// Bounded small pictures of scans, as features see them, as data URIs; none without a file.
class RangeImages {
 public:
  explicit RangeImages(size_t most_bytes) : most_bytes_(most_bytes) {}

  /// The key of a scan's picture in images() or ""; `turned`: alignment case 2.
  std::string add(const std::string& scan_file, const reports::RunInfo& info, bool turned);

  const std::map<std::string, std::string>& images() const { return images_; }
  /// Why pictures are missing, for people; "" when none is.
  const std::string& warning() const { return warning_; }

 private:
  size_t most_bytes_, bytes_ = 0;
  std::map<std::string, std::string> images_;  // "case1 4000x112 /data/000123.bin" -> data URI
  std::string warning_;
};

}  // namespace revisit::cli

#pragma once

#include <filesystem>
#include <map>
#include <string>

#include "reports.pb.h"
#include "revisit/pipeline/describe.h"

namespace revisit::cli {

/// Small pictures of scans as the features see them: in a folder, and as data URIs. Their number of
/// bytes is bounded; a scan whose file is gone has none.
class RangeImages {
 public:
  RangeImages(std::filesystem::path folder, size_t most_bytes)
      : folder_(std::move(folder)), most_bytes_(most_bytes) {}

  /// The key of a scan's picture in images(), or "" when there is none. `turned`: in alignment case
  /// 2. Throws Error when it cannot be written.
  std::string add(const std::string& scan_file, int frame, const reports::RunInfo& info,
                  bool turned);

  const std::map<std::string, std::string>& images() const { return images_; }
  /// Why pictures are missing, for people; "" when none is.
  const std::string& warning() const { return warning_; }

 private:
  std::filesystem::path folder_;
  size_t most_bytes_, bytes_ = 0;
  std::map<std::string, std::string> images_;  // "05_000123_case1" -> data URI
  std::string warning_;
};

}  // namespace revisit::cli

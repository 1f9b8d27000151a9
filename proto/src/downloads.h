#pragma once

#include <algorithm>
#include <string>
#include <string_view>

#include "revisit/base/text.h"

namespace revisit::proto {

/// Returns what a file is that was downloaded in place of a model, and what to do, or "".
inline std::string wrong_download(std::string_view head) {
  if (head.starts_with("version https://git-lfs.github.com/spec/"))
    return "is a Git LFS pointer; fetch the file itself: git lfs pull";
  head.remove_prefix(std::min(head.find_first_not_of(" \t\r\n"), head.size()));
  const std::string start = lower(std::string(head.substr(0, 9)));
  if (start == "<!doctype" || start.starts_with("<html") || start.starts_with("<head") ||
      start.starts_with("<?xml"))
    return "is a web page; download the file itself (on GitHub: Raw)";
  return "";
}

}  // namespace revisit::proto

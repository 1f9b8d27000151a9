#pragma once

#include <string>

namespace revisit::cli {

/// `format`: of strftime().
std::string local_time(const char* format);

}  // namespace revisit::cli

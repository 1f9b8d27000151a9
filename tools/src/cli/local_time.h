#pragma once

#include <string>

namespace revisit::cli {

/// Now, as strftime() writes it in this format.
std::string local_time(const char* format);

}  // namespace revisit::cli

#pragma once

#include <string>

namespace revisit::cli {

/// Prints "note: ..." or "warning: ..." to standard error.
void note(const std::string& message);
void warn(const std::string& message);
void warn_skipped(const std::string& why);

}  // namespace revisit::cli

#include "cli/messages.h"

#include <iostream>

namespace revisit::cli {
void note(const std::string& message) {
  std::cerr << "note: " << message << "\n";
}

void warn(const std::string& message) {
  std::cerr << "warning: " << message << "\n";
}

void warn_skipped(const std::string& why) {
  warn(why + "; the scan is skipped");
}

}  // namespace revisit::cli

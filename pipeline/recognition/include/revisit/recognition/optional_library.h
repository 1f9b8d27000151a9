#pragma once

#include <span>
#include <string_view>

namespace revisit::pipeline {

/// A library without which the rest can be built.
struct OptionalLibrary {
  std::string_view name;     ///< "PCL"
  std::string_view package;  ///< Debian's, e.g. "libpcl-dev"
  std::string_view option;   ///< CMake's, e.g. "REVISIT_PCL"
  std::string_view use;      ///< what does not work without it
  bool built_in;
};

/// The table in pipeline/CMakeLists.txt.
std::span<const OptionalLibrary> optional_libraries();

/// The row of this name. Throws std::logic_error for one that is not in the table.
const OptionalLibrary& optional_library(std::string_view name);

/// Throws UsageError with the package and option that `what` needs, unless `library` is built in.
void need(std::string_view what, std::string_view library);

/// The same where the code that needs it was left out of the build.
[[noreturn]] void built_without(std::string_view what, std::string_view library);

}  // namespace revisit::pipeline

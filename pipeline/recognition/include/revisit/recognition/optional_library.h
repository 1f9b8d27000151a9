#pragma once

#include <span>
#include <string_view>

namespace revisit {

/// A library that a build may lack.
struct OptionalLibrary {
  std::string_view name;     ///< "PCL"
  std::string_view package;  ///< Debian package, e.g. "libpcl-dev"
  std::string_view option;   ///< CMake option, e.g. "REVISIT_PCL"
  std::string_view use;      ///< features that need it
  bool built_in;             ///< this build has it
};

/// Returns the table of pipeline/CMakeLists.txt.
std::span<const OptionalLibrary> optional_libraries();

/// Throws std::logic_error if the table lacks the name.
const OptionalLibrary& optional_library(std::string_view name);

/// Throws UsageError with the package and option that `what` needs.
[[noreturn]] void built_without(std::string_view what, std::string_view library);

}  // namespace revisit

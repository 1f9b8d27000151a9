#include "revisit/recognition/optional_library.h"

#include <algorithm>
#include <stdexcept>

#include "revisit/base/error.h"

namespace revisit::pipeline {
namespace {

constexpr OptionalLibrary kLibraries[] = {
#include "optional_libraries.inc"  // by CMake
};

}  // namespace

std::span<const OptionalLibrary> optional_libraries() {
  return kLibraries;
}

const OptionalLibrary& optional_library(std::string_view name) {
  const auto found = std::ranges::find(kLibraries, name, &OptionalLibrary::name);
  if (found == std::end(kLibraries))
    throw std::logic_error(str("'", name, "' is not in the table of optional libraries"));
  return *found;
}

void need(std::string_view what, std::string_view library) {
  if (!optional_library(library).built_in) built_without(what, library);
}

void built_without(std::string_view what, std::string_view library) {
  const OptionalLibrary& missing = optional_library(library);
  throw UsageError(what, ": this program was built without ", missing.name, "; install ",
                   missing.package, " and build it with -D", missing.option, "=ON");
}

}  // namespace revisit::pipeline

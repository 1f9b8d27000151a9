#include "revisit/recognition/optional_library.h"

#include <algorithm>
#include <stdexcept>

#include "revisit/proto/error.h"

namespace revisit::pipeline {
namespace {

constexpr OptionalLibrary kLibraries[] = {
#include "optional_libraries.inc"  // by CMake
};

const OptionalLibrary& find(std::string_view name) {
  const auto found = std::ranges::find(kLibraries, name, &OptionalLibrary::name);
  if (found == std::end(kLibraries))
    throw std::logic_error(str("'", name, "' is not in the table of optional libraries"));
  return *found;
}

}  // namespace

std::span<const OptionalLibrary> optional_libraries() {
  return kLibraries;
}

void need(std::string_view what, std::string_view library) {
  if (!find(library).built_in) built_without(what, library);
}

void built_without(std::string_view what, std::string_view library) {
  const OptionalLibrary& missing = find(library);
  throw UsageError(str(what, ": this program was built without ", missing.name, "; install ",
                       missing.package, " and build it with -D", missing.option, "=ON"));
}

}  // namespace revisit::pipeline

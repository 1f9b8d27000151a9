#include "cli/built_in.h"

#include "revisit/base/error.h"
#include "revisit/base/text.h"
#include "revisit/maps/map_store.h"
#include "revisit/recognition/optional_library.h"

namespace revisit::cli {

constexpr const char* kHowToComplete = "`tools/build.sh` in its sources builds it with everything";

void need_built_in(const std::string& option, std::string_view library) {
  if (!optional_library(library).built_in)
    throw UsageError(option, ": this program was built without ", library, "; ", kHowToComplete);
}

void need_built_in_for_map(const std::string& option, const std::filesystem::path& map) {
  if (is_server_address(map.string())) need_built_in(option, "libpq");
}

std::string built_in_text() {
  std::vector<std::string> built_in;
  std::string missing;
  for (const OptionalLibrary& library : optional_libraries())
    if (library.built_in)
      built_in.emplace_back(library.name);
    else
      missing += str("not built in: ", library.name, " (", library.use, ")\n");
  if (!missing.empty()) missing += str(kHowToComplete, "\n");
  return str("built in: ", built_in.empty() ? "no optional library" : joined(built_in, ", "), "\n",
             missing);
}

}  // namespace revisit::cli

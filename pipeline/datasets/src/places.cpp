#include "places.h"

#include <algorithm>

#include "folder.h"
#include "revisit/base/error.h"
#include "revisit/base/text.h"

namespace revisit {
namespace {

namespace fs = std::filesystem;

bool is_visible_folder(const fs::path& path) {
  std::error_code ignored;
  return !path.filename().string().starts_with(".") && fs::is_directory(path, ignored);
}
bool is_place(const fs::path& path) {
  return is_visible_folder(path) && holds_scans(path);
}
bool is_set(const fs::path& path) {
  return is_visible_folder(path) && holds(path, is_place);
}

}  // namespace

PlaceFolders find_places(const fs::path& root, const std::string& sequence) {
  PlaceFolders found;
  found.name = fs::canonical(root).filename().string();
  fs::path folder = root;
  std::vector<std::string> names;
  if (sequence.empty()) names = list_names(root, is_place);
  if (names.empty()) {
    const std::vector<std::string> sets = list_names(root, is_set);
    if (sets.empty()) return found;
    const std::string list = joined(sets, ", ");
    if (!sequence.empty() && std::find(sets.begin(), sets.end(), sequence) == sets.end())
      throw InputError(root.string(), ": there is no set of places '", sequence, "'",
                       nearest_name_hint(sequence, sets), "; sets with a folder per place: ", list);
    if (sequence.empty() && sets.size() > 1)
      throw InputError(
          root.string(),
          ": several sets of places, select one (as the sequence); sets with a folder per "
          "place: ",
          list);
    found.sequence = sequence.empty() ? sets[0] : sequence;
    folder = root / found.sequence;
    names = list_names(folder, is_place);
  }
  for (const std::string& name : names) found.places.push_back(folder / name);
  return found;
}

}  // namespace revisit

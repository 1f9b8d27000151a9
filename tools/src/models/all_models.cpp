#include "models/all_models.h"

#include <algorithm>

#include "cli/messages.h"
#include "models/cache.h"
#include "revisit/base/error.h"

namespace revisit::models {

namespace {

std::vector<KnownModel>::const_iterator row_of(const FoundModel& model) {
  return std::ranges::find(known_models(), model.name, &KnownModel::name);
}

}  // namespace

std::vector<FoundModel> all_models(const std::vector<std::filesystem::path>& folders) {
  if (folders.empty()) {
    const std::filesystem::path cache = cache_folder();
    return std::filesystem::exists(cache) ? all_models({cache}) : std::vector<FoundModel>();
  }
  std::vector<FoundModel> all;
  for (const std::filesystem::path& folder : folders) {
    if (!std::filesystem::is_directory(folder))
      throw UsageError(folder.string() + ": no such folder (--models)");
    for (const std::filesystem::path& weights : weights_below(folder)) try {
        FoundModel found = find_model({.weights = weights});
        if (std::ranges::count(all, found.name, &FoundModel::name) == 0)
          all.push_back(std::move(found));
      } catch (const Error& unusable) {
        cli::warn(str(weights.string(), " is skipped: ", unusable.what()));
      }
  }
  std::ranges::stable_sort(
      all, {}, [](const FoundModel& model) { return std::pair(!model.trained, row_of(model)); });
  return all;
}

std::vector<Cut> cuts_of(const FoundModel& model) {
  const auto row = row_of(model);
  return row == known_models().end() ? std::vector{model.cut} : row->cuts;
}

}  // namespace revisit::models

#include "models/all_models.h"

#include <algorithm>

#include "cli/messages.h"
#include "models/cache.h"
#include "revisit/base/error.h"

namespace revisit::models {

std::vector<FoundModel> all_models(const std::vector<std::filesystem::path>& folders,
                                   std::vector<std::string>* passed_over) {
  std::vector<FoundModel> all;
  for (const std::filesystem::path& folder : folders)
    for (const std::filesystem::path& weights : weights_below(folder)) try {
        FoundModel found = find_model({.weights = weights});
        if (std::ranges::count(all, found.name, &FoundModel::name) == 0)
          all.push_back(std::move(found));
      } catch (const Error& unusable) {
        passed_over->push_back(str(weights.string(), ": ", cli::message_of(unusable)));
      }
  std::ranges::stable_sort(all, {}, [](const FoundModel& model) {
    const KnownModel* known = known_model_of(model);
    return std::pair(!model.trained, known ? known - known_models().data() : PTRDIFF_MAX);
  });
  return all;
}

const KnownModel* known_model_of(const FoundModel& model) {
  for (const KnownModel& known : known_models())
    if (known.name == model.name || (!model.trained && !known.trunk.empty() &&
                                     model.prototxt.filename().string().starts_with(known.trunk)))
      return &known;
  return nullptr;
}

}  // namespace revisit::models

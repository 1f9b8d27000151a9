#include "doctor/checks.h"
#include "models/cache.h"
#include "models/fetch.h"
#include "revisit/base/error.h"

namespace revisit::doctor {
namespace fs = std::filesystem;

void check_models(Checks& checks) {
  fs::path cache;
  try {
    cache = models::cache_folder();
  } catch (const Error& error) {
    checks.push_back({"models", "cache", Status::kWarn, "no place", error.what()});
    return;
  }
  bool any = false;
  const auto loose = models::loose_weights(cache);
  for (const models::KnownModel& model : models::known_models()) {
    Check check{"models", model.name, Status::kOk, ""};
    try {
      const models::CacheEntry entry = models::inspect(cache, model, loose);
      if (entry.state == models::CacheState::kAbsent) continue;
      check.found = str(models::to_string(entry.state), ", ", entry.file.string());
      any |= entry.state == models::CacheState::kVerified ||
             entry.state == models::CacheState::kUnverified;
      if (entry.state == models::CacheState::kPartial) {
        check.status = Status::kWarn;
        check.advice = str("'revisit models fetch ", model.name, "' gets the rest");
      } else if (entry.state == models::CacheState::kIncorrect) {
        check.status = Status::kWarn;
        check.advice = "remove it; " + models::how_to_get(model, cache);
      }
    } catch (const std::exception& error) {
      check.status = Status::kWarn;
      check.found = error.what();
    }
    checks.push_back(check);
  }
  if (!any)
    checks.push_back({"models", "trained network", Status::kMissing,
                      str("none in ", cache.string()),
                      "'revisit models fetch bvlc_alexnet', or give --model and --weights; to try "
                      "the machinery: 'revisit models make-random -o DIR'"});
}

}  // namespace revisit::doctor

#include "baselines.h"

#include "revisit/base/files.h"
#include "revisit/baselines/baselines.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

FeatureExtractor scan_context(const FeatureOptions& options, const Dataset&, const fs::path&) {
  return scan_context_features({.ring_key_candidates = options.preselected()});
}

bool wants_samples(const FeatureOptions& options) {
  if (options.new_place == "mean-field") return false;
  if (options.new_place != "sampled")
    throw UsageError("--new-place: expected mean-field or sampled, found '" + options.new_place +
                     "'");
  if (options.training_images.empty())
    throw UsageError(
        "--new-place sampled: needs images of other places; give them with --training-images DIR");
  return true;
}

FeatureExtractor fabmap(const FeatureOptions& options, const Dataset& dataset,
                        const fs::path& folder) {
  const bool sampled = wants_samples(options);
  const Observer observer = options.observer();
  TrainingOptions training;
  training.threads = options.thread_count();
  training.progress = observer.stage("training words", "images");
  training.stop = observer.stop;
  make_folder(folder);
  const Dataset images = options.training_images.empty() ? camera_images(dataset, options.images)
                                                         : image_folder(options.training_images);
  return fabmap_features(train_vocabulary(images, training, folder), sampled);
}

struct Baseline {
  const char* name;
  FeatureExtractor (*make)(const FeatureOptions&, const Dataset&, const fs::path&);
  const char* library = nullptr;
};

const Baseline kBaselines[] = {
    {"vfh", [](const auto&, const auto&, const auto&) { return vfh_features(); }, "PCL"},
    {"esf", [](const auto&, const auto&, const auto&) { return esf_features(); }, "PCL"},
    {"grsd", [](const auto&, const auto&, const auto&) { return grsd_features(); }, "PCL"},
    {"scan-context", scan_context},
    {"m2dp", [](const auto&, const auto&, const auto&) { return m2dp_features(); }},
    {"fabmap", fabmap, "OpenCV"},
};

}  // namespace

std::vector<std::string> baseline_names() {
  std::vector<std::string> names;
  for (const Baseline& baseline : kBaselines) names.emplace_back(baseline.name);
  return names;
}

std::optional<std::string> library_of_baseline(const std::string& name) {
  for (const Baseline& baseline : kBaselines)
    if (name == baseline.name && baseline.library) return baseline.library;
  return std::nullopt;
}

FeatureExtractor baseline(const FeatureOptions& options, const Dataset& dataset,
                          const fs::path& folder) {
  for (const Baseline& baseline : kBaselines)
    if (options.feature == baseline.name) return baseline.make(options, dataset, folder);
  throw UsageError("--feature: unknown feature '" + options.feature + "'");
}

}  // namespace revisit::cli

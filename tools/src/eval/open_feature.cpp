#include <algorithm>
#include <cmath>
#include <string_view>

#include "cli/net_arrays.h"
#include "cli/net_options.h"
#include "cli/terminal.h"
#include "eval/feature_options.h"
#include "loops/recording.h"
#include "models/models.h"
#include "revisit/base/files.h"
#include "revisit/baselines/baselines.h"
#include "revisit/datasets/scan_file.h"
#include "revisit/maps/map_store.h"
#include "revisit/recognition/align.h"
#include "revisit/recognition/range_image.h"
#include "revisit/recognition/ring/descriptor.h"
#include "revisit/recognition/ring/model.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

std::optional<std::array<double, 3>> parse_mean(const std::string& text) {
  if (text.empty()) return std::nullopt;
  std::array<double, 3> mean{};
  std::vector<double> means = channel_means(parse_mean_option("--mean", text));
  if (means.size() == 1) means.resize(mean.size(), means[0]);
  if (means.size() != mean.size())
    throw UsageError("--mean: ", text, " has ", means.size(), " channels, expected 3 or 1");
  std::ranges::copy(means, mean.begin());
  return mean;
}

/// Folders of --images: of the drive, and of other places; "" if not given.
std::array<fs::path, 2> image_folders(const FeatureOptions& options) {
  std::vector<std::string> folders = comma_separated(options.images);
  if (folders.size() > 2)
    throw UsageError("--images: expected one or two folders, found '", options.images, "'");
  folders.resize(2);
  return {folders[0], folders[1]};
}

FeatureExtractor scan_context(const FeatureOptions& options, const Dataset&, const fs::path&) {
  return scan_context_features({.candidates = options.preselected()});
}

FeatureExtractor fabmap(const FeatureOptions& options, const Dataset& dataset,
                        const fs::path& folder) {
  make_folder(folder);
  const auto [own, others] = image_folders(options);
  // Images of other places are samples of a new place; without them it is a mean field.
  const bool sampled = !others.empty();
  const Dataset images = sampled ? image_folder(others) : camera_images(dataset, own);
  return fabmap_features(images, sampled, folder, options.thread_count(), options.observer());
}

struct Baseline {
  std::string_view name;
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

FeatureSource open_network(const FeatureOptions& options) {
  models::FoundModel model = models::find_model(
      {options.model, options.weights, options.end, parse_mean(options.mean_bgr)});
  for (const std::string& warning : model.warnings) warn(warning);
  if (!model.trained)
    note(str("the network '", model.name,
             "' is UNTRAINED (random weights): results do not measure accuracy"));
  const auto [end, graft] = parse_cut(model.cut);
  const engine::Net net =
      engine::Net::load(model.prototxt, model.weights, {.end = end, .graft = graft});
  for (const std::string& warning : net.warnings()) warn(warning);
  const std::string key = str("net ", models::file_sha1(model.prototxt), " ", model.weights_sha1);
  FeatureSource source;
  source.extractor =
      network_features(net, key, model.mean_bgr, options.image.geometry(),
                       {.threads = options.threads_per_scan, .precision = options.precision});
  source.model = std::move(model);
  return source;
}

[[noreturn]] void throw_unknown_sensor(const Dataset& dataset) {
  std::string reason;
  try {
    read_scan(dataset.scans.at(0));
  } catch (const InputError& error) {
    reason = str(" (", error.what(), ")");
  }
  throw InputError(
      "--feature ring: no model can be chosen, because none of the first scans can be read", reason,
      "; give --sensor");
}

FeatureSource open_ring(const FeatureOptions& options, const Dataset& dataset) {
  if (options.ring.empty() && options.image.is_auto()) throw_unknown_sensor(dataset);
  const RingModel model =
      options.ring.empty()
          ? shipped_ring_model(options.image.sensor,
                               options.weights.empty() ? "" : models::file_sha1(options.weights))
          : read_ring_model(options.ring);
  if (!options.ring.empty() && !options.quiet) warn_of_other_sensor(dataset, model.sensor);
  fs::path weights;
  if (model.weights.empty()) {
    weights = options.weights.empty() ? models::find_model({}).weights : options.weights;
    if (models::file_sha1(weights) != model.weights_sha1)
      throw InputError(weights.string(), ": not the weights that ", options.ring.string(),
                       " was trained with (SHA-1 ", model.weights_sha1,
                       "); give them with --weights");
  }
  RingOptions ring_options;
  ring_options.candidates = options.preselected();
  FeatureSource source;
  source.extractor =
      ring_recognizer(model, ring_net(model, weights), ring_options,
                      {.threads = options.threads_per_scan, .precision = options.precision});
  return source;
}

/// Scans of a recording, for several passes.
Dataset spooled_recording(const FeatureOptions& options, bool needs_poses) {
  RecordedScans scans = read_recording(options);
  cli::Progress progress("reading", "scans", !options.quiet);
  scans.next = [&, next = std::move(scans.next), n = int64_t{0}]() mutable {
    progress.update(n, std::max(n, scans.count));
    ++n;
    return next();
  };
  Dataset dataset = spooled(scans);
  if (needs_poses && !dataset.has_poses())
    throw InputError(options.data.string(), ": ", std::ssize(dataset.scans) - dataset.n_poses,
                     " of ", dataset.scans.size(),
                     " scans have no pose; give a drive that has poses (bags and packets have "
                     "none), or --poses where the command has it");
  return dataset;
}

/// Readable scans from all parts of the drive, enough to recognize the sensor.
std::vector<PointCloud> some_scans(const Dataset& dataset) {
  constexpr size_t kEnough = 3, kTried = 20;
  std::vector<PointCloud> scans;
  const size_t n = std::min(dataset.scans.size(), kTried);
  for (size_t i = 0; i < n && scans.size() < kEnough; ++i) {
    // Halves, then quarters: 0, 1/2, 1/4, 3/4, ... of the drive.
    size_t at = 0;
    for (size_t bit = i, part = dataset.scans.size() / 2; bit > 0; bit /= 2, part /= 2)
      at += bit % 2 * part;
    try {
      scans.push_back(read_scan(dataset.scans[at]));
    } catch (const InputError&) {  // reported when the scan is described
    }
  }
  return scans;
}

bool is_range_image_feature(const FeatureSource& source) {
  return source.extractor.sees<RangeImage>();
}

int64_t components_for(const FeatureOptions& options, const FeatureSource& source) {
  constexpr int64_t kDefault = 400, kNoPca = -1;
  const std::optional<int64_t> components = options.components();
  if (components == kNoPca) {
    if (options.fitted_on() != "all")
      throw UsageError("--fit-on: not with --pca none; leave out one of the two");
    return kNoPca;
  }
  const bool requested = components || options.fitted_on() != "all";
  if (requested && source.extractor.comparison.similarity)
    throw UsageError("--pca: not supported by the feature ", source.extractor.name,
                     ", which has a similarity of its own; leave it out");
  return components.value_or(requested || is_range_image_feature(source) ? kDefault : kNoPca);
}

AlignCase align_for(const FeatureOptions& options, const FeatureSource& source) {
  const auto mode =
      parse_align_case(options.align.value_or(is_range_image_feature(source) ? "case1" : "none"));
  if (mode != AlignCase::kNone && source.extractor.sees<GrayImage>())
    throw UsageError("--align: not supported by the feature ", source.extractor.name,
                     ", which uses camera images; leave it out");
  return mode;
}

}  // namespace

std::vector<std::string> feature_names() {
  std::vector<std::string> names{"cnn", "data", "ring"};
  for (const Baseline& baseline : kBaselines) names.emplace_back(baseline.name);
  return names;
}

std::optional<std::string> library_of_baseline(const std::string& name) {
  for (const Baseline& baseline : kBaselines)
    if (name == baseline.name && baseline.library) return baseline.library;
  return std::nullopt;
}

FeatureSource open_feature(const FeatureOptions& options, const Dataset& dataset,
                           const fs::path& folder) {
  const std::vector<std::string> names = feature_names();
  if (std::find(names.begin(), names.end(), options.feature) == names.end())
    throw UsageError("--feature: unknown feature '", options.feature, "'",
                     nearest_name_hint(options.feature, names), "; known: ", joined(names, ", "));
  FeatureSource source;
  if (options.feature == "cnn")
    source = open_network(options);
  else if (options.feature == "data")
    source.extractor = range_vector_features(options.image.geometry());
  else if (options.feature == "ring")
    source = open_ring(options, dataset);
  else
    source.extractor = std::ranges::find(kBaselines, options.feature, &Baseline::name)
                           ->make(options, dataset, folder);
  source.inputs = source.extractor.sees<GrayImage>()
                      ? camera_images(dataset, image_folders(options)[0])
                      : dataset;
  source.align = align_for(options, source);
  source.components = components_for(options, source);
  return source;
}

/// some_scans() in the frame of --mount.
std::vector<PointCloud> mounted_scans(const FeatureOptions& options, const Dataset& dataset) {
  std::vector<PointCloud> scans = some_scans(dataset);
  if (!options.mount.empty())
    for (PointCloud& scan : scans) transform(parse_mount(options.mount), scan);
  return scans;
}

std::string resolve_sensor(FeatureOptions& options, const Dataset& dataset,
                           const std::string& map_key) {
  const bool is_ring = options.feature == "ring";
  const bool sees_image =
      options.feature == "cnn" || options.feature == "data" || (is_ring && options.ring.empty());
  const auto has = [&](const std::vector<std::string>& names) {
    return std::ranges::find(names, options.image.sensor) != names.end();
  };
  const bool nearest = is_ring && has(sensor_names()) && !has(shipped_ring_models());
  if (!sees_image || !(options.image.is_auto() || nearest)) return "";
  const std::vector<PointCloud> scans = mounted_scans(options, dataset);
  if (scans.empty() && !(is_ring && !shipped_ring_sensor(map_key).empty())) return "";
  if (!is_ring) return options.image.resolve(scans);
  const auto [sensor, reason] = choose_ring_model(
      scans, map_key, options.weights.empty() ? "" : models::file_sha1(options.weights));
  options.image.sensor = sensor;
  return str(sensor, " (", reason, ")");
}

void warn_of_view(const FeatureOptions& options, const Dataset& dataset) {
  const std::string misfit = find_view_defect(mounted_scans(options, dataset));
  if (!misfit.empty()) warn(str(dataset.name, dataset.name.empty() ? "" : ": ", misfit));
}

std::string sensor_of(const Dataset& dataset) {
  return find_sensor(some_scans(dataset)).name;
}

void warn_of_other_sensor(const Dataset& dataset, const std::string& sensor) {
  const std::string found = sensor_of(dataset);
  const std::vector<std::string> known = sensor_names();
  if (found.empty() || found == sensor || std::ranges::find(known, sensor) == known.end()) return;
  warn(str(dataset.name, ": the sensor of these scans looks like ", found, ", not ", sensor,
           "; a model of another sensor is less accurate"));
}

Dataset scans_so_far(const FeatureOptions& options, bool needs_poses) {
  if (!options.topics.empty())
    throw UsageError("--topics: ", options.data.string(), " is not a bag; remove the option");
  Dataset dataset = open_dataset(options.data, options.sequence, needs_poses);
  std::erase_if(dataset.scans,
                [&](const ScanRef& scan) { return scan.frame % options.every != 0; });
  return dataset;
}

Dataset open_scans(const FeatureOptions& options, bool needs_poses) {
  Dataset dataset = is_recording(options.data) ? spooled_recording(options, needs_poses)
                                               : scans_so_far(options, needs_poses);
  if (!options.quiet)
    for (const std::string& warning : dataset.warnings) warn(warning);
  find_point_times(dataset, options.point_times);
  const bool asked = options.point_times != "none" && dataset.point_times != "none";
  if (!options.quiet && asked && !dataset.point_times.empty())
    note(str("point times: ", dataset.point_times,
             "; only `revisit loops` and `revisit eval --causal` deskew"));
  if (dataset.scans.empty())
    throw UsageError("--every ", options.every, ": no frame number of ", options.data.string(),
                     " is a multiple of ", options.every);
  return dataset;
}

Dataset open_drive(FeatureOptions options, const fs::path& data, const std::string& sensor,
                   bool needs_poses) {
  options.data = data;
  Dataset drive = open_scans(options, needs_poses);
  if (!options.quiet) warn_of_other_sensor(drive, sensor);
  return drive;
}

std::string names_of(const std::vector<Dataset>& drives) {
  return joined(drives, ", ", [](const Dataset& drive) {
    return str(drive.scans.size(), " scans of ", drive.name, drive.sequence.empty() ? "" : "/",
               drive.sequence);
  });
}

std::string points_outside(double share, const ImageGeometry& geometry, const PointCloud& scan) {
  const std::string fitting = find_sensor({scan}).name;
  return str(number(100 * share, 0),
             " % of a scan's points are outside of the range image, which spans ",
             number(geometry.elevation_top, 1), " to ", number(geometry.elevation_bottom, 1),
             " degrees; give --sensor ", fitting.empty() ? "auto" : fitting);
}

void warn_of_points_outside(const FeatureOptions& options, const Dataset& dataset,
                            const std::vector<AlignmentRecord>& records) {
  std::vector<float> shares;
  for (const AlignmentRecord& record : records)
    if (!std::isnan(record.outside)) shares.push_back(record.outside);
  if (shares.empty() || options.quiet) return;
  const auto middle = shares.begin() + static_cast<std::ptrdiff_t>(shares.size() / 2);
  std::nth_element(shares.begin(), middle, shares.end());
  const float median = *middle;
  if (!(double{median} > kManyOutside)) return;
  const auto typical =
      std::ranges::find(records, median, &AlignmentRecord::outside) - records.begin();
  const PointCloud scan = read_scan(dataset.scans[static_cast<size_t>(typical)]);
  warn(str(points_outside(double{median}, options.image.geometry(), scan), " (median of ",
           shares.size(), " scans)"));
}

}  // namespace revisit::cli

#include "feature_options.h"

#include <algorithm>
#include <memory>
#include <thread>

#include "cli/built_in.h"
#include "cli/interrupt.h"
#include "cli/mean_file.h"
#include "cli/messages.h"
#include "cli/net_options.h"
#include "cli/progress.h"
#include "eval/baselines.h"
#include "models/checksum.h"
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
  if (std::error_code none; fs::is_regular_file(text, none)) {
    const std::vector<double> means = channel_means(read_mean(text));
    if (means.size() == 1)
      mean.fill(means[0]);
    else if (means.size() == mean.size())
      std::copy(means.begin(), means.end(), mean.begin());
    else
      throw UsageError("--mean: ", text, " has ", means.size(), " channels, expected 3 or 1");
    return mean;
  }
  std::vector<double> numbers;
  for (const std::string& field : comma_separated(text))
    numbers.push_back(parse_value<double>("--mean", field));
  if (numbers.size() == 1 && text.back() != ',') numbers.resize(mean.size(), numbers[0]);
  if (numbers.size() != mean.size())
    throw UsageError(str(
        "--mean: expected three numbers B,G,R or a .npy or .binaryproto file, found '", text, "'"));
  std::ranges::copy(numbers, mean.begin());
  return mean;
}

/// Chooses cnn for an option of networks alone (--model, --end) without --feature.
void choose_feature(const Options& options, std::string* feature) {
  if (options.given("feature", Source::kConfigFile)) return;
  for (const Row& row : options.rows())
    // A variable of the environment serves many commands and chooses nothing.
    if (row.features == "cnn" &&
        (row.source == Source::kCommandLine || row.source == Source::kConfigFile))
      *feature = "cnn";
}

/// Throws UsageError if the library of a feature is not built in, or no feature uses an option on
/// the command line. Files and the environment may hold more.
void check_features(const Options& options, const std::vector<std::string>& features) {
  for (const std::string& feature : features)
    if (const auto library = library_of_baseline(feature))
      need_built_in("--feature " + feature, *library);
  for (const Row& row : options.rows())
    if (row.source == Source::kCommandLine &&
        std::ranges::none_of(features, [&](const auto& name) { return row.belongs_to(name); }))
      throw UsageError(row.spelled(), " belongs to --feature ",
                       row.features.substr(0, row.features.find(' ')), ", not to --feature ",
                       joined(features, ","));
}

}  // namespace

void FeatureOptions::declare(Options& options, Scans scans, bool several) {
  options.argument("DATA", &data);
  options.group("Data:");
  options.option("sequence", "NN", "sequence of a KITTI root that has several, e.g. 00", &sequence)
      .common();
  options
      .option("every", "N", "frame stride: only frame numbers that are multiples of N (default 1)",
              &every)
      .at_least(1)
      .common();
  declare_describing(options, scans, several);
}

void FeatureOptions::declare_describing(Options& options, Scans scans, bool several) {
  const bool of_drives = scans == Scans::kOfDrives;
  std::vector<std::string> names = feature_names();
  if (!of_drives) std::erase(names, "fabmap");
  image.declare(options);
  if (!of_drives)
    options
        .option("mount", "R,P,Y,X,Y,Z",
                "roll, pitch, yaw [deg] and shift [m] that take points to x forward, y left, z up, "
                "e.g. "
                "180,0,0,0,0,0 for a sensor upside down (default: none)",
                &mount)
        .common();
  options.group("Feature:");
  options
      .option("feature", "NAME",
              std::string("ring (ring descriptors), cnn (output of a layer), data (the range "
                          "image), vfh, esf, grsd, "
                          "scan-context, m2dp") +
                  (of_drives ? ", fabmap (camera images)" : "") + " (default " + feature +
                  ", or cnn with --model or --end)",
              &feature)
      .suggest(names)
      .common(of_drives);
  options
      .option("model", "P", "cnn: prototxt, or name of a known model (default: the best one found)",
              &model)
      .suggest(models::known_model_names())
      .of_features("cnn")
      .common(of_drives);
  options.option("weights", "W", "cnn and ring: caffemodel (default: the model's)", &weights)
      .of_features("cnn ring");
  options
      .option("end", "LAYER[+LAYER]",
              "cnn: layer whose output is the feature, e.g. conv3, or conv3+pool5 with a copy of "
              "the pooling layer after it",
              &end)
      .of_features("cnn")
      .common(of_drives);
  options
      .option("mean", "B,G,R|M|FILE",
              "cnn: channel means to subtract, as numbers (one for all channels) or a "
              ".binaryproto or .npy file "
              "(default: the model's)",
              &mean_bgr)
      .of_features("cnn");
  if (of_drives)
    options.option(
        "align", "none|case1|case2",
        "alignment of scans to their principal directions (default case1 for cnn and data, "
        "else none)",
        &align);
  declare_ring(options, of_drives);
  if (of_drives) declare_baselines(options);
  declare_running(options, of_drives);
  options.check([this, &options, several] {
    choose_feature(options, &feature);
    check_features(options, several ? comma_separated(feature) : std::vector{feature});
  });
}

void FeatureOptions::declare_ring(Options& options, bool of_drives) {
  options.group("Ring descriptors:");
  options
      .option("ring", "FILE",
              "ring model of `revisit train` (default: the shipped model for the sensor)", &ring)
      .of_features("ring");
  options
      .option("candidates", "N",
              str("candidates that are compared exactly, 0: all. ring and scan-context: "
                  "preselected by compact codes (default ",
                  default_candidates, ")",
                  of_drives ? ""
                            : ". Others: from an HNSW graph (FAISS), for maps of over 100,000 "
                              "entries (default 0)"),
              &candidates)
      .at_least(0)
      .of_features(of_drives ? "ring scan-context" : "");
}

void FeatureOptions::declare_baselines(Options& options) {
  options.group("Baselines:");
  options
      .option("images", "DIR",
              "fabmap: PNG images named by frame number (default: image_0 of the sequence)",
              &images)
      .of_features("fabmap");
  options
      .option("training-images", "DIR",
              "fabmap: images that train the vocabulary (default: the drive's)", &training_images)
      .of_features("fabmap");
  options
      .option("new-place", "mean-field|sampled",
              "fabmap: likelihood of a new place; sampled needs --training-images (default "
              "mean-field)",
              &new_place)
      .of_features("fabmap");
}

void FeatureOptions::declare_running(Options& options, bool of_drives) {
  options.group("Reduction:");
  options.option("pca", "K|all|none|DIR",
                 "components of the PCA; all or 0: as many as the data gives; none: no PCA; DIR: a "
                 "folder with a PCA (default 400 for cnn and data, else none)",
                 &pca);
  if (of_drives)
    options.choice("fit-on", {"all", "map"},
                   "scans that the PCA or the map mean is estimated from: all, or the stored ones "
                   "(default all)",
                   &fit_on);
  if (of_drives)
    options.option("memory", "GB", "working memory of the PCA (default 2)", &memory_gb)
        .at_least(0.001);  // less cannot hold a handful of descriptors
  options.group("Running:", false);
  options.option("threads", "N", "threads (default: all cores)", &threads).at_least(0).common();
  if (of_drives) {
    declare_precision(options, &precision);
    options
        .option("cache", "DIR",
                "folder of features and descriptors, regenerated if it is removed (default: "
                "OUTPUT/features, "
                "features only)",
                &cache)
        .common();
  }
  options.flag("quiet", "only results and errors, no progress line", &quiet, 'q').common();
}

int FeatureOptions::thread_count() const {
  return threads ? threads : std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
}

std::optional<int64_t> FeatureOptions::components() const {
  if (pca.empty()) return std::nullopt;
  if (fitted_on() == pca) return 0;
  if (pca == "none") return -1;
  if (pca == "all") return 0;
  const auto number = parse_value<int64_t>("--pca", pca);
  if (number < 0) throw UsageError("--pca: expected at least 0, all or none, found ", number);
  return number;
}

std::string FeatureOptions::fitted_on() const {
  std::error_code none;
  return fs::is_directory(pca, none) ? pca : fit_on;
}

DescribeOptions FeatureOptions::describe(const FeatureSource& source) const {
  return {.geometry = image.geometry(),
          .align = source.align,
          .threads = std::max(1, thread_count() / threads_per_scan)};
}

ReductionOptions FeatureOptions::reduction(const FeatureSource& source) const {
  return {source.components, fitted_on(), memory_gb, thread_count()};
}

Observer FeatureOptions::observer() const {
  Observer observer;
  observer.stop = interrupted;
  if (quiet) return observer;
  observer.note = note;
  observer.warn = warn;
  observer.stage = [](const char* verb, const char* unit) {
    return [line = std::make_shared<Progress>(verb, unit)](int64_t done, int64_t total) {
      line->update(done, total);
    };
  };
  return observer;
}

fs::path FeatureOptions::cache_folder(const fs::path& output) const {
  return cache.empty() ? output / "features" : fs::path(cache);
}

namespace {

FeatureSource open_network(const FeatureOptions& options) {
  const engine::Truncation cut = parse_cut(options.end);
  models::FoundModel model = models::find_model(
      {options.model, options.weights, cut.end, cut.graft, parse_mean(options.mean_bgr)});
  for (const std::string& warning : model.warnings) warn(warning);
  if (!model.trained)
    note(str("the network '", model.name,
             "' is UNTRAINED (random weights): results do not measure accuracy"));
  const engine::Net net = engine::Net::load(model.prototxt, model.weights,
                                            {{model.cut.end, model.cut.graft}, {}, false, false});
  for (const std::string& warning : net.warnings()) warn(warning);
  const std::string key = str("net ", models::file_sha1(model.prototxt), " ", model.weights_sha1);
  FeatureSource source;
  source.extractor =
      network_features(net, key, model.mean_bgr, options.image.geometry(),
                       {.threads = options.threads_per_scan, .precision = options.precision});
  source.model = std::move(model);
  return source;
}

FeatureSource open_ring(const FeatureOptions& options, const Dataset& dataset) {
  if (options.ring.empty() && options.image.is_auto())
    throw InputError(
        "--feature ring: no model can be chosen, because none of the first scans can be read; give "
        "--sensor");
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
  ring_options.code_candidates = options.preselected();
  FeatureSource source;
  source.extractor =
      ring_recognizer(model, ring_net(model, weights), ring_options,
                      {.threads = options.threads_per_scan, .precision = options.precision});
  return source;
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
      scans.push_back(read_scan(dataset.scans[at].file));
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
  const std::vector<std::string> others = baseline_names();
  names.insert(names.end(), others.begin(), others.end());
  return names;
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
    source.extractor = baseline(options, dataset, folder);
  source.inputs =
      source.extractor.sees<GrayImage>() ? camera_images(dataset, options.images) : dataset;
  source.align = align_for(options, source);
  source.components = components_for(options, source);
  return source;
}

std::string similarity_name(const FeatureSource& source) {
  return source.extractor.comparison.similarity ? "similarity" : "cosine";
}

/// some_scans() in the frame of --mount.
std::vector<PointCloud> mounted_scans(const FeatureOptions& options, const Dataset& dataset) {
  std::vector<PointCloud> scans = some_scans(dataset);
  if (!options.mount.empty())
    for (PointCloud& scan : scans) transform(parse_mount(options.mount), scan);
  return scans;
}

std::string resolve_sensor(FeatureOptions& options, const Dataset& dataset, const fs::path& map) {
  const bool sees_image = options.feature == "cnn" || options.feature == "data" ||
                          (options.feature == "ring" && options.ring.empty());
  if (!sees_image || !options.image.is_auto()) return "";
  const std::vector<PointCloud> scans = mounted_scans(options, dataset);
  if (scans.empty()) return "";
  if (options.feature != "ring") return options.image.resolve(scans);
  const RingModelChoice choice = choose_ring_model(scans, feature_key_of(map));
  options.image.sensor = choice.sensor;
  return str(choice.sensor, " (", choice.reason, ")");
}

void warn_of_view(const FeatureOptions& options, const Dataset& dataset) {
  const std::string misfit = find_view_defect(mounted_scans(options, dataset));
  if (!misfit.empty()) warn(str(dataset.name, ": ", misfit));
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
  Dataset dataset = open_dataset(options.data, options.sequence, needs_poses);
  std::erase_if(dataset.scans,
                [&](const ScanRef& scan) { return scan.frame % options.every != 0; });
  return dataset;
}

Dataset open_scans(const FeatureOptions& options, bool needs_poses) {
  Dataset dataset = scans_so_far(options, needs_poses);
  if (!options.quiet)
    for (const std::string& warning : dataset.warnings) warn(warning);
  if (dataset.scans.empty())
    throw UsageError("--every ", options.every, ": no frame number of ", options.data.string(),
                     " is a multiple of ", options.every);
  return dataset;
}

}  // namespace revisit::cli

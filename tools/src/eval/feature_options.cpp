#include "feature_options.h"

#include <algorithm>
#include <memory>
#include <thread>

#include "cli/built_in.h"
#include "cli/net_options.h"
#include "cli/terminal.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

/// Chooses cnn for an option of networks alone (--model, --end) without --feature.
void choose_feature(const Options& options, std::string* feature) {
  if (options.given("feature", Source::kConfigFile)) return;
  for (const Row& row : options.rows())
    // A variable of the environment serves many commands and chooses nothing.
    if (row.features == "cnn" &&
        (row.source == Source::kCommandLine || row.source == Source::kConfigFile))
      *feature = "cnn";
}

/// Throws UsageError if the library of the feature is not built in, or it does not use an option on
/// the command line. Files and the environment may hold more.
void check_feature(const Options& options, const std::string& feature) {
  if (const auto library = library_of_baseline(feature))
    need_built_in("--feature " + feature, *library);
  for (const Row& row : options.rows())
    if (row.source == Source::kCommandLine && !row.belongs_to(feature))
      throw UsageError(row.spelled(), " belongs to --feature ",
                       row.features.substr(0, row.features.find(' ')), ", not to --feature ",
                       feature);
}

}  // namespace

void FeatureOptions::declare(Options& options, Scans scans) {
  options.argument("DATA", &data);
  declare_data(options);
  declare_describing(options, scans);
}

void FeatureOptions::declare_data(Options& options) {
  options.group("Data:");
  options
      .option("sequence", "NAME",
              "sequence of a data set that has several (00, scene-0061, Ouster); "
              "TOPIC[@FRAME_ID] of a bag",
              &sequence)
      .common();
  options
      .option("topics", "A,B",
              "topics of a bag that are merged into one scan per sweep, in the frame and at the "
              "stamps of the first",
              &topics)
      .excludes({"sequence"})
      .option("extrinsics", "FILE",
              "poses of these sensors, lines `NAME x y z qx qy qz qw` with a topic or frame_id "
              "(default: the bag's TF)",
              &extrinsics)
      .needs("topics");
  options
      .option("every", "N", "frame stride: only frame numbers that are multiples of N (default 1)",
              &every)
      .at_least(1)
      .common();
  options.choice("point-times", {"auto", "s", "ms", "us", "ns", "scan", "none"},
                 "unit of the times of points; scan: 0 to 1 of a scan (default auto: from the "
                 "period of the scans)",
                 &point_times);
}

void FeatureOptions::declare_describing(Options& options, Scans scans) {
  const bool of_drives = scans == Scans::kOfDrives;
  std::vector<std::string> names = feature_names();
  if (!of_drives) std::erase(names, "fabmap");
  image.declare(options);
  if (!of_drives)
    options
        .option("mount", "R,P,Y,X,Y,Z",
                "roll, pitch, yaw [deg] and shift [m] that take points to x forward, y left, z up, "
                "e.g. 180,0,0,0,0,0 for a sensor upside down (default: none)",
                &mount)
        .common();
  options.group("Feature:");
  options
      .option("feature", "NAME",
              std::string("ring (ring descriptors), cnn (output of a layer), data (the range "
                          "image), vfh, esf, grsd, scan-context, m2dp") +
                  (of_drives ? ", fabmap (camera images)" : "") + " (default " + feature +
                  ", or cnn with --model, --end or --mean)",
              &feature)
      .suggest(names)
      .common(of_drives);
  declare_cnn(options, of_drives);
  if (of_drives)
    options.option("align", "none|case1|case2",
                   "alignment of scans to their principal directions (default case1 for cnn and "
                   "data, else none)",
                   &align);
  declare_ring(options, scans);
  if (of_drives) declare_baselines(options);
  declare_running(options, of_drives);
  options.check([this, &options, scans] {
    choose_feature(options, &feature);
    check_feature(options, feature);
    if (scans == Scans::kOneByOne && graph_candidates() > 0) need_built_in("--candidates", "FAISS");
  });
}

void FeatureOptions::declare_cnn(Options& options, bool of_drives) {
  options
      .option("model", "P", "cnn: prototxt, or name of a known model (default: the best one found)",
              &model)
      .suggest(models::known_model_names())
      .of_features("cnn")
      .common(of_drives);
  options.option("weights", "W", "cnn and ring: caffemodel (default: the model's)", &weights)
      .of_features("cnn ring");
  options
      .option(
          "end", "LAYER[+LAYER]",
          "cnn: layer of the feature, e.g. conv3; conv3+pool5 appends a copy of the pooling layer",
          &end)
      .of_features("cnn")
      .common(of_drives);
  options
      .option("mean", "B,G,R|M|FILE",
              "cnn: channel means to subtract, as numbers (one for all channels) or a .binaryproto "
              "or .npy file (default: the model's)",
              &mean_bgr)
      .of_features("cnn");
}

void FeatureOptions::declare_ring(Options& options, Scans scans) {
  options.group("Ring descriptors:");
  options
      .option("ring", "FILE",
              "ring model of `revisit train` (default: the shipped model for the sensor)", &ring)
      .of_features("ring");
  if (scans == Scans::kStored) return;
  const bool of_drives = scans == Scans::kOfDrives;
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
      .option("images", "DIR[,DIR]",
              "fabmap: PNG images named by frame number (default: image_0 of the sequence); then "
              "images of other places, which train the vocabulary and the likelihood of a new "
              "place (default: the drive's images, and a mean field)",
              &images)
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
  declare_threads(options);
  if (of_drives) {
    declare_precision(options, &precision);
    options.option("cache", "DIR",
                   "folder of features and descriptors, regenerated if it is removed (default: "
                   "OUTPUT/features, features only)",
                   &cache);
  }
}

void FeatureOptions::declare_threads(Options& options) {
  options.group("Running:", false)
      .option("threads", "N", "threads (default: all cores)", &threads)
      .at_least(0)
      .common()
      .flag("quiet", "only results and errors, no progress line", &quiet, 'q')
      .common();
}

void FeatureOptions::declare_local_map(Options& options) {
  options.option(
      "local-map", "METERS",
      "path length of local maps, 1 to 200 (e.g. 10), for sensors with a limited field of view or "
      "few points; accumulated by poses, else by registration; with the model of hdl64 unless "
      "--sensor is given (default: none, single scans)",
      &local_map);
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

}  // namespace revisit::cli

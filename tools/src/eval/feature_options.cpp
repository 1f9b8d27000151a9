#include "feature_options.h"

#include <algorithm>
#include <iostream>
#include <sstream>
#include <thread>

#include "cli/interrupt.h"
#include "cli/mean_file.h"
#include "cli/progress.h"
#include "models/checksum.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

std::optional<std::array<double, 3>> parse_mean(const std::string& text) {
  if (text.empty()) return std::nullopt;
  std::array<double, 3> mean{};
  if (std::error_code none; fs::is_regular_file(text, none)) {
    const std::vector<double> means = channel_means(read_mean(text));
    if (means.size() != mean.size())
      throw UsageError(str("--mean-bgr: ", text, " has ", means.size(), " channels, expected 3"));
    std::copy(means.begin(), means.end(), mean.begin());
    return mean;
  }
  std::istringstream fields(text);
  std::string field;
  for (double& value : mean) {
    if (!std::getline(fields, field, ','))
      throw UsageError(
          "--mean-bgr: expected three numbers B,G,R or a .npy or .binaryproto file, found '" +
          text + "'");
    value = parse_value<double>("--mean-bgr", field);
  }
  if (std::getline(fields, field))
    throw UsageError(
        "--mean-bgr: expected three numbers B,G,R or a .npy or .binaryproto file, found '" + text +
        "'");
  return mean;
}

void append(std::vector<double>& to, const std::vector<double>& from) {
  to.insert(to.end(), from.begin(), from.end());
}

}  // namespace

void FeatureOptions::declare(Parser& parser) {
  parser.positional("DATA", &data);
  parser.group("Data:");
  parser.option("sequence", "NN",
                "sequence of a KITTI root, e.g. 00 (not needed when there is one)", &sequence);
  parser.option("sensor", "NAME",
                "geometry of the range image: hdl64, hdl32, vlp16 (default hdl64)", &sensor);
  parser.option("width", "PIXELS", "columns of the range image (default: the sensor's, 4000)",
                &width);
  parser.option("height", "PIXELS", "rows of the range image (default: the sensor's)", &height);
  parser.option("max-range", "METRES", "range of pixel value 255 (default 80)", &max_range);
  parser.group("Feature:");
  parser.option("feature", "net|data",
                "output of a network, or the range image itself (default net)", &feature);
  parser.option("model", "P",
                "prototxt, or the name of a known model (default: the best one found)", &model);
  parser.option("weights", "W", "caffemodel", &weights);
  parser.option("end", "LAYER", "the layer that is the feature", &end);
  parser.option("graft", "LAYER", "pooling layer of the net to append, e.g. pool5", &graft);
  parser.option("mean-bgr", "B,G,R|FILE",
                "channel means to subtract, or a .binaryproto or .npy mean to take them from "
                "(default: the model's own)",
                &mean_bgr);
  parser.group("Reduction:");
  parser.option("pca", "K", "numbers a scan (default 400; 0: as many as the data gives)",
                &components);
  parser.option("pca-fit", "all|map|DIR",
                "scans the PCA learns from, or a folder it was written to (default all)", &pca_fit);
  parser.option("memory", "GB", "working memory of the PCA (default 2)", &memory_gb);
  parser.group("Running:");
  parser.option("threads", "N", "scans in flight, one thread each (default: all cores)", &threads);
  parser.option("cache", "DIR", "where features are kept (default: OUTPUT/features)", &cache);
  parser.flag("no-progress", "no progress line", &no_progress);
  parser.flag("quiet", "only results and errors", &quiet, 'q');
}

pipeline::ImageGeometry FeatureOptions::geometry() const {
  pipeline::ImageGeometry geometry = pipeline::sensor_geometry(sensor);
  if (width < 0 || height < 0 || max_range < 0)
    throw UsageError("--width, --height and --max-range must be positive");
  if (width) geometry.width = width;
  if (height) geometry.height = height;
  if (max_range > 0) geometry.max_range = max_range;
  return geometry;
}

int FeatureOptions::thread_count() const {
  if (threads < 0) throw UsageError(str("--threads: expected at least 1, found ", threads));
  return threads ? threads : std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
}

FeatureSource open_feature(const FeatureOptions& options) {
  const pipeline::ImageGeometry geometry = options.geometry();
  if (options.feature == "data") return {pipeline::range_vector_features(geometry), std::nullopt};
  if (options.feature != "net")
    throw UsageError("--feature: expected net or data, found '" + options.feature + "'");

  models::FoundModel model = models::find_model(
      {options.model, options.weights, options.end, options.graft, parse_mean(options.mean_bgr)});
  for (const std::string& warning : model.warnings) std::cerr << "warning: " << warning << "\n";
  if (!model.trained)
    std::cerr << "note: the network '" << model.name
              << "' is UNTRAINED (random weights): it shows that the machinery works and proves "
                 "nothing about accuracy\n";
  const engine::Net net = engine::Net::load(model.prototxt, model.weights,
                                            {{model.cut.end, model.cut.graft}, {}, false, false});
  for (const std::string& warning : net.warnings()) std::cerr << "warning: " << warning << "\n";
  const std::string key = str("net ", models::file_checksum(model.prototxt, "sha256"), " ",
                              models::file_checksum(model.weights, "sha256"));
  pipeline::FeatureExtractor extractor =
      pipeline::network_features(net, key, model.mean_bgr, geometry);
  return {std::move(extractor), std::move(model)};
}

Features compute_features(const FeatureOptions& options, const pipeline::Dataset& dataset,
                          const FeatureSource& source, pipeline::AlignMode align,
                          const fs::path& folder, pipeline::DescribeTimes* times) {
  pipeline::DescribeOptions describe;
  describe.geometry = options.geometry();
  describe.align = align;
  describe.threads = options.thread_count();
  describe.stop = interrupted;
  Progress progress("describing", "scans", !options.no_progress && !options.quiet);
  describe.progress = progress.callback();

  std::error_code error;
  fs::create_directories(folder, error);
  if (error) throw Error(str(folder.string(), ": cannot create the folder: ", error.message()));
  const pipeline::FeaturePaths paths =
      pipeline::feature_paths(folder, dataset, source.extractor, describe);
  const pipeline::DescribeTimes spent =
      pipeline::write_features(paths, dataset, source.extractor, describe);
  append(times->read, spent.read);
  append(times->image, spent.image);
  append(times->feature, spent.feature);
  return {pipeline::FeatureFile(paths.features), pipeline::read_alignments(paths.alignments)};
}

}  // namespace revisit::cli

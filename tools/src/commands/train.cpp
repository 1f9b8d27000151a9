#include <iostream>

#include "cli/command.h"
#include "eval/feature_options.h"
#include "revisit/base/files.h"
#include "revisit/datasets/train_ring.h"
#include "revisit/recognition/range_image.h"
#include "revisit/recognition/ring/descriptor.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

struct TrainOptions {
  std::vector<fs::path> data;
  std::string sensor = "hdl64";
  fs::path model, weights, output, cache;
  std::string layers = "pool1=64";
  double sensor_height = RingModel().sensor_height;
  TrainRingOptions learn;
  FeatureOptions running;  // only threads, progress, sequence and stride

  void declare(Options& options);
};

void TrainOptions::declare(Options& options) {
  options.argument("DATA", &data)
      .option("output", "FILE", "file of the model", &output, 'o')
      .required();
  running.declare_data(options);
  options.option("sensor", "NAME", "sensor of the scans (default hdl64)", &sensor)
      .suggest(sensor_names())
      .group("Network:")
      .option("model", "P", "prototxt, or name of a known model", &model)
      .suggest(models::known_model_names())
      .option("weights", "W", "caffemodel", &weights)
      .option("layers", "LAYER=N[,...]",
              "layers whose azimuth columns are features, in the net's order, and the dimensions "
              "kept of each (default pool1=64)",
              &layers)
      .group("Training:")
      .choice<RingSupervision>("from",
                               {{"loops", RingSupervision::kLoops},
                                {"odometry", RingSupervision::kOdometry},
                                {"sequence", RingSupervision::kSequence},
                                {"scans", RingSupervision::kScans}},
                               "source of scan pairs of one place: loops (poses of a drive with "
                               "revisits), odometry (poses; scans near in space and time), "
                               "sequence (each scan and the next), scans (none) (default loops)",
                               &learn.supervision)
      .option("radius", "METERS", "maximum distance of scans of one place (default 5)",
              &learn.radius)
      .positive()
      .option("augment", "N",
              "perturbed copies of every scan: tilt, hidden sectors, short range, missing beams "
              "(default 2)",
              &learn.augmentations)
      .at_least(0)
      .option("sensor-height", "METERS",
              "mean height of the sensor above the ground, for gravity alignment (default 1.73)",
              &sensor_height)
      .option("cache", "DIR", "folder of the ring features (default: FILE.rings)", &cache);
  running.declare_threads(options);
}

std::vector<std::pair<std::string, int>> parse_layers(const std::string& text) {
  std::vector<std::pair<std::string, int>> layers;
  for (const std::string& entry : comma_separated(text)) {
    const size_t equals = entry.rfind('=');
    if (equals == std::string::npos || equals == 0)
      throw UsageError("--layers: expected LAYER=N[,...], e.g. pool1=32,pool4=32, found '" + text +
                       "'");
    layers.emplace_back(entry.substr(0, equals),
                        parse_value<int>("--layers", entry.substr(equals + 1)));
  }
  if (layers.empty()) throw UsageError("--layers: expected LAYER=N[,...], found nothing");
  return layers;
}

constexpr size_t kMaxBytesOfWeightsInModel = 256 << 10;

int train(TrainOptions& o) {
  check_target(o.output);
  const Observer observer = o.running.observer();
  std::vector<Dataset> drives;
  for (const fs::path& data : o.data)
    drives.push_back(open_drive(o.running, data, o.sensor, false));
  const LayerDimensions layers = parse_layers(o.layers);
  const models::FoundModel found =
      models::find_model({o.model, o.weights, layers.back().first, {}});
  RingModel model;
  model.sensor = o.sensor;
  model.image = ring_geometry(o.sensor);
  model.sensor_height = o.sensor_height;
  model.prototxt = read_content(found.prototxt);
  model.weights_sha1 = found.weights_sha1;
  model.mean_bgr = found.mean_bgr;
  if (fs::file_size(found.weights) <= kMaxBytesOfWeightsInModel)
    model.weights = read_content(found.weights);
  const engine::Net net =
      engine::Net::load(found.prototxt, found.weights, {.end = layers.back().first});
  o.learn.threads = o.running.thread_count();
  o.learn.cache = o.cache.empty() ? fs::path(o.output.string() + ".rings") : o.cache;
  model.trained_on = names_of(drives);
  train_ring_model(model, net, layers, drives, o.learn, observer);
  write_ring_model(o.output, model);
  std::cout << "ring model for " << model.sensor << ", trained on " << model.trained_on << ": "
            << o.output.string() << " (" << fs::file_size(o.output) / 1024 << " kB)\n";
  return kOk;
}

}  // namespace

Command train_command() {
  return {
      "train", "train a ring model on drives",
      "Trains a ring model on drives of one sensor: the features that scans of one place share. "
      "DATA is a KITTI sequence, a folder of scans, a recording, or output of `revisit simulate`. "
      "The model is one file, for --ring FILE.",
      "  revisit train town -o town.ring --model squeezenet.prototxt --layers pool1=32,pool4=32\n"
      "  revisit train scans/ -o scans.ring --model net/ --from sequence   # no poses needed\n",
      with_options<TrainOptions>(train)};
}

}  // namespace revisit::cli

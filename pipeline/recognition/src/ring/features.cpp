#include <algorithm>
#include <memory>

#include "align/ground.h"
#include "feature/image_plan.h"
#include "revisit/base/files.h"
#include "revisit/recognition/range_image.h"
#include "revisit/recognition/ring/descriptor.h"
#include "revisit/recognition/ring/model.h"
#include "ring/describer.h"
#include "ring/extraction.h"

namespace revisit {
ImageGeometry ring_geometry(const std::string& sensor) {
  constexpr int kWidth = 1024, kMaxRows = 64;
  ImageGeometry image = sensor_geometry(sensor);
  const int beams = std::ranges::find(sensors(), sensor, &Sensor::name)->beams;
  // Rays without beams leave most of a larger image empty.
  image.width = beams > 0 ? kWidth : kWidth / 2;
  image.height = beams > 0 ? std::min(beams, kMaxRows) : kMaxRows / 2;
  // Closes holes of 5 columns and 3 rows. With few beams, gaps between rows are not holes.
  image.closing_width = 5 * 360.0 / image.width;
  const double row = (image.elevation_top - image.elevation_bottom) / image.height;
  image.closing_height = (beams > 0 && beams < kMaxRows ? 1 : 3) * row;
  return image;
}

engine::Net ring_net(const RingModel& model, const std::filesystem::path& weights) {
  if (model.weights.empty() && weights.empty())
    throw InputError("the ring model for ", model.sensor, " has no weights (SHA-1 ",
                     model.weights_sha1, "); pass the caffemodel that it was trained with");
  return engine::Net::load_from_memory(
      model.prototxt, weights.empty() ? model.weights : read_content(weights),
      {.end = model.layers.empty() ? "" : model.layers.back().name});
}

FeatureExtractor ring_features(const RingModel& model, const engine::Net& net,
                               const engine::PlanOptions& forward) {
  constexpr double kDown = -10;  // [deg]: a higher field shows no ground nearby
  std::vector<std::string> layers;
  for (const RingLayer& layer : model.layers) layers.push_back(layer.name);
  const auto plan =
      std::make_shared<const CnnRingPlan>(model, layers, model.cnn.sectors, net, forward);
  for (size_t i = 0; i < model.layers.size(); ++i)
    if (model.layers[i].directions.d != plan->maps()[i].rows)
      throw InputError("layer '", model.layers[i].name, "': columns have ", plan->maps()[i].rows,
                       " values, the ring model expects ", model.layers[i].directions.d);
  FeatureExtractor extractor;
  extractor.name = "ring";
  extractor.dim = model.dim();
  extractor.key = extraction_key(model) + precision_key(forward.precision);
  const auto reductions = std::make_shared<const std::vector<ColumnProjection>>(
      model.layers.begin(), model.layers.end());
  extractor.make = [plan, reductions, grid = model.grid, height = model.sensor_height,
                    shows_ground = model.image.elevation_bottom < kDown,
                    parts = parts_of(model)]() -> FeatureFunction<PointCloud> {
    const auto runner = std::make_shared<CnnRingPlan::Runner>(*plan);
    return [plan, runner, reductions, grid, height, shows_ground, parts](const PointCloud& cloud,
                                                                         std::span<float> feature) {
      const PointCloud leveled = level(cloud, height, shows_ground);
      runner->forward(leveled);
      const auto& [cnn, polar] = parts;
      float* ring = feature.data();
      for (size_t i = 0; i < reductions->size(); ++i) {
        const ColumnProjection& reduce = (*reductions)[i];
        reduce(plan->maps()[i], runner->map(i), cnn.sectors, ring);
        ring += reduce.features() * cnn.sectors;
      }
      const auto range = [&](int64_t first, int64_t size) {
        return feature.subspan(static_cast<size_t>(first), static_cast<size_t>(size));
      };
      runner->seen(range(cnn.first_weight, cnn.sectors));
      polar_ring(leveled, grid, height, range(polar.first, polar.size()),
                 range(polar.first_weight, int64_t{polar.weights} * polar.sectors));
    };
  };
  return extractor;
}

FeatureExtractor ring_recognizer(const RingModel& model, const engine::Net& net,
                                 const RingOptions& options, const engine::PlanOptions& forward) {
  check_options(options);
  FeatureExtractor extractor = ring_features(model, net, forward);
  extractor.fit_projection = [model, options](const Rows& rings,
                                              std::span<const int64_t> fit_rows) {
    RingModel fitted = model;
    fitted.calibration
        .reset();  // maps with one projection can be merged, whatever their calibration
    fit_to_map(fitted, rings, fit_rows, options.blend);
    return ring_projection(fitted, options);
  };
  extractor.open_projection = [options, dim = extractor.dim](const std::string& content) {
    const RingModel fitted = parse_ring_model(content, "the descriptor projection");
    if (fitted.dim() != dim)  // an untrusted map may have another size
      throw InputError("the descriptor projection is for features of ", fitted.dim(),
                       " floats, expected ", dim);
    return ring_projection(fitted, options);
  };
  extractor.comparison = ring_comparison({});  // cosine does not compare its descriptors
  const RingOptions usual;                     // the options of shipped calibrations
  if (options.dim == usual.dim && options.regularization == usual.regularization &&
      options.blend == usual.blend)
    extractor.calibration = model.calibration;
  return extractor;
}

}  // namespace revisit

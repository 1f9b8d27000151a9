#include "revisit/recognition/ring/features.h"

#include <algorithm>
#include <memory>

#include "feature/precision_key.h"
#include "revisit/proto/file_content.h"
#include "revisit/proto/text.h"
#include "revisit/recognition/ring/learn.h"
#include "revisit/recognition/sensor.h"
#include "ring/columns.h"
#include "ring/model_content.h"

namespace revisit::pipeline {
namespace {

std::vector<std::string> layer_names(const RingModel& model) {
  std::vector<std::string> names;
  for (const LayerColumns& layer : model.layers) names.push_back(layer.layer);
  return names;
}

/// The heights as a ring.
void height_ring(const PointCloud& cloud, const PolarGrid& grid, std::span<float> ring) {
  polar_heights(cloud, grid, ring);
  // Azimuth grows with the sector of the grid, and falls with a ring's.
  for (int r = 0; r < grid.rings; ++r) {
    const auto row =
        ring.subspan(static_cast<size_t>(r) * grid.sectors, static_cast<size_t>(grid.sectors));
    std::reverse(row.begin(), row.end());
  }
}

}  // namespace

ImageGeometry ring_geometry(const std::string& sensor) {
  constexpr int kWidth = 1024, kMostRows = 64;
  ImageGeometry image = sensor_geometry(sensor);
  const int beams = std::ranges::find(sensors(), sensor, &Sensor::name)->beams;
  image.width = kWidth;
  image.height = beams > 0 ? std::min(beams, kMostRows) : kMostRows;
  // 5 columns and 3 rows; where beams are far apart holes between them are no holes.
  image.closing_width = 5 * 360.0 / kWidth;
  const double row = (image.elevation_top - image.elevation_bottom) / image.height;
  image.closing_height = (image.height < kMostRows ? 1 : 3) * row;
  return image;
}

engine::Net ring_net(const RingModel& model, const std::filesystem::path& weights) {
  if (model.weights.empty() && weights.empty())
    throw InputError(str("the ring model for ", model.sensor,
                         " needs the caffemodel it was learnt with (SHA-1 ", model.weights_sha1,
                         "): give the file"));
  return engine::Net::load_from_memory(
      model.prototxt, weights.empty() ? model.weights : read_content(weights),
      {.truncation = {.end = model.layers.empty() ? "" : model.layers.back().layer}});
}

FeatureExtractor ring_features(const RingModel& model, const engine::Net& net,
                               const Forward& forward) {
  const auto plan = std::make_shared<const ColumnPlan>(model, layer_names(model),
                                                       model.columns.sectors, net, forward);
  for (size_t i = 0; i < model.layers.size(); ++i)
    if (model.layers[i].directions.d != plan->maps()[i].rows)
      throw InputError(str("layer '", model.layers[i].layer, "' has columns of ",
                           plan->maps()[i].rows, " numbers, the ring model was learnt on ",
                           model.layers[i].directions.d));
  FeatureExtractor extractor;
  extractor.name = "ring";
  extractor.dim = model.dim();
  extractor.key =
      str("ring ", short_name_of(extraction_content(model)), precision_key(forward.precision));
  const auto reductions = std::make_shared<const std::vector<ColumnReduction>>(model.layers.begin(),
                                                                               model.layers.end());
  extractor.make = [plan, reductions, grid = model.heights,
                    sectors = model.columns.sectors]() -> FeatureFunction<PointCloud> {
    const auto runner = std::make_shared<ColumnPlan::Runner>(*plan);
    return
        [plan, runner, reductions, grid, sectors](const PointCloud& cloud, std::span<float> rings) {
          runner->forward(cloud);
          for (size_t i = 0; i < reductions->size(); ++i) {
            const ColumnReduction& reduce = (*reductions)[i];
            reduce(plan->maps()[i], runner->map(i), sectors, rings.data());
            rings = rings.subspan(static_cast<size_t>(reduce.numbers() * sectors));
          }
          height_ring(cloud, grid, rings);
        };
  };
  return extractor;
}

namespace {

/// Descriptors made with these options have the scores that a model was calibrated to.
bool calibrated_with(const RingOptions& options) {
  const RingOptions usual;
  return options.numbers == usual.numbers && options.regularisation == usual.regularisation &&
         options.adapt == usual.adapt;
}

Basis basis_of(const RingModel& fitted, const RingOptions& options) {
  const RingDescriber describer(fitted, options);
  const RingLayout& layout = describer.layout();
  Basis basis;
  basis.dim = layout.numbers();
  basis.describe = [describer](std::span<const float> rings, std::span<float> descriptor) {
    describer.describe(rings, descriptor);
  };
  basis.comparison = ring_comparison(layout, options.key_candidates);
  basis.content = ring_model_content(fitted);
  return basis;
}

}  // namespace

FeatureExtractor ring_recogniser(const RingModel& model, const engine::Net& net,
                                 const RingOptions& options, const Forward& forward) {
  check_options(options);
  FeatureExtractor extractor = ring_features(model, net, forward);
  extractor.reduce = [model, options](const Rows& rings, std::span<const int64_t> learn_from) {
    RingModel fitted = model;
    fitted.calibration.reset();  // maps of one basis can be merged, however they are calibrated
    fit_to_map(fitted, rings, learn_from, options.adapt);
    return basis_of(fitted, options);
  };
  extractor.open_basis = [options](const std::string& content) {
    return basis_of(parse_ring_model(content, "the basis"), options);
  };
  extractor.comparison = ring_comparison({});  // its descriptors': no cosine
  if (calibrated_with(options)) extractor.calibration = model.calibration;
  return extractor;
}

}  // namespace revisit::pipeline

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include "revisit/recognition/matrix.h"
#include "ring/extraction.h"

namespace revisit {

void fill_between_beams(RangeImage& image, int rows) {
  const auto width = static_cast<size_t>(image.width);
  std::vector<int> last(width, -1);  // [column], row of the last return above
  for (int row = 0; row < image.height; ++row) {
    float* const pixels = image.pixels.data() + static_cast<size_t>(row) * width;
    for (size_t column = 0; column < width; ++column) {
      if (pixels[column] == 0) continue;
      const int above = last[column], gap = row - above;
      last[column] = row;
      if (above < 0 || gap < 2 || gap > rows + 1) continue;
      float* const top = image.pixels.data() + static_cast<size_t>(above) * width + column;
      const float first = 1 / *top, step = (1 / pixels[column] - first) / static_cast<float>(gap);
      for (int i = 1; i < gap; ++i)
        top[static_cast<size_t>(i) * width] = 1 / (first + step * static_cast<float>(i));
    }
  }
}

namespace {

/// 1/8 of the width: more than half the receptive field of the layers used.
constexpr int kMarginShare = 8;
/// Largest gap between beams that is filled [deg]: every fourth beam of a sensor with 64.
constexpr double kMaxGap = 3.6;

const engine::LayerCost& layer_of(const engine::Plan& plan, const std::string& name) {
  const auto found = std::ranges::find(plan.layers(), name, &engine::LayerCost::name);
  if (found == plan.layers().end())
    throw InputError("the net of the ring model has no layer '", name, "'");
  return *found;
}

ColumnMap map_of(const engine::LayerCost& layer, int width, int margin, int sectors) {
  const engine::Shape& shape = layer.outputs.at(0);
  if (shape.rank() != 4 || !layer.field_w)
    throw InputError("layer '", layer.name, "' has an output of ", shape,
                     ", expected a feature map 1 x c x h x w whose columns see a part of the "
                     "image");
  const engine::ReceptiveField& field = *layer.field_w;
  if (width % field.stride != 0 || (width / field.stride) % sectors != 0)
    throw InputError("layer '", layer.name, "' has a column every ", field.stride,
                     " pixels; an image of ", width, " columns does not give ", sectors,
                     " sectors");
  ColumnMap map;
  map.rows = shape[1] * shape[2];
  map.width = shape[3];
  // The column whose receptive field is centered nearest to the image's first pixel.
  map.first = std::lround(
      (static_cast<double>(margin - field.start) - 0.5 * static_cast<double>(field.size - 1)) /
      static_cast<double>(field.stride));
  map.merged = width / field.stride / sectors;
  if (map.first < 0 || map.first + map.merged * sectors > map.width)
    throw InputError("layer '", layer.name, "' has a receptive field of ", field.size,
                     " pixels, too wide for an image of ", width, " columns");
  return map;
}

}  // namespace

CnnRingPlan::CnnRingPlan(const RingModel& model, const std::vector<std::string>& layers,
                         int sectors, const engine::Net& net, const engine::PlanOptions& forward)
    : geometry_(model.image),
      layers_(layers),
      margin_(model.image.width / kMarginShare),
      images_(plan_for_images(
          net, model.image.height, model.image.width + 2 * margin_, model.mean_bgr, 1,
          {.threads = forward.threads, .keep = layers, .precision = forward.precision})) {
  check_geometry(geometry_);
  for (const std::string& layer : layers_)
    maps_.push_back(map_of(layer_of(images_.plan, layer), geometry_.width, margin_, sectors));
}

CnnRingPlan::Runner::Runner(const CnnRingPlan& plan) : plan_(plan), run_(plan.images_.plan) {}

void CnnRingPlan::Runner::forward(const PointCloud& leveled) {
  const ImageGeometry& geometry = plan_.geometry_;
  project_rotated(leveled, Eigen::Matrix3f::Identity(), geometry, image_);
  const double rows_a_degree =
      geometry.height / (geometry.elevation_top - geometry.elevation_bottom);
  fill_between_beams(image_, static_cast<int>(kMaxGap * rows_a_degree));
  image_ = close_holes(std::move(image_), geometry);
  const int margin = plan_.margin_;
  const auto width = static_cast<size_t>(geometry.width);
  continued_.resize((width + 2 * margin) * geometry.height);
  float* to = continued_.data();
  for (int r = 0; r < geometry.height; ++r) {
    const float* const row = image_.pixels.data() + r * width;
    to = std::copy(row + width - margin, row + width, to);
    to = std::copy(row, row + width, to);
    to = std::copy(row, row + margin, to);
  }
  plan_.images_.fill(run_, continued_);
  run_.forward();
}

void CnnRingPlan::Runner::seen(std::span<float> weights) const {
  const size_t columns = static_cast<size_t>(image_.width) / weights.size();
  std::vector<char> has(static_cast<size_t>(image_.width));
  for (auto row = image_.pixels.begin(); row != image_.pixels.end(); row += image_.width)
    for (size_t column = 0; column < has.size(); ++column)
      if (row[static_cast<ptrdiff_t>(column)] > 0) has[column] = 1;
  for (size_t sector = 0; sector < weights.size(); ++sector)
    weights[sector] = static_cast<float>(std::count(
                          has.begin() + static_cast<ptrdiff_t>(sector * columns),
                          has.begin() + static_cast<ptrdiff_t>((sector + 1) * columns), 1)) /
                      static_cast<float>(columns);
}

const float* CnnRingPlan::Runner::map(size_t layer) const {
  return run_.layer_output(plan_.layers_[layer]).data;
}

ColumnProjection::ColumnProjection(const RingLayer& layer) : directions_(layer.directions) {
  for (int64_t i = 0; i < features(); ++i) {
    const auto direction = directions_.row(i);
    mean_.push_back(static_cast<float>(
        std::inner_product(direction.begin(), direction.end(), layer.mean.begin(), 0.0)));
  }
}

void ColumnProjection::operator()(const ColumnMap& map, const float* values, int sectors,
                                  float* ring) const {
  const int64_t columns = map.merged * sectors;
  std::vector<float> reduced(static_cast<size_t>(features() * columns));
  multiply(features(), columns, map.rows, directions_.values.data(), map.rows, values + map.first,
           map.width, reduced.data(), columns);
  const float* from = reduced.data();
  for (const float mean : mean_)
    for (int sector = 0; sector < sectors; ++sector, from += map.merged)
      *ring++ =
          std::accumulate(from, from + map.merged, 0.0F) / static_cast<float>(map.merged) - mean;
}

}  // namespace revisit

#pragma once

#include <span>
#include <string>
#include <vector>

#include "feature/image_plan.h"
#include "revisit/recognition/point_cloud.h"
#include "revisit/recognition/range_image.h"
#include "revisit/recognition/ring/model.h"

namespace revisit {

/// Fills gaps of at most `rows` pixels between two returns of a column, for sensors with fewer
/// beams than rows. Interpolates 1/range, because on a plane it is nearly linear in the elevation.
void fill_between_beams(RangeImage& image, int rows);

/// Columns of a layer's feature map that lie over the range image: `[rows][width]` floats. Column k
/// of the ring is the mean of columns first + k * merged to first + (k + 1) * merged - 1.
struct ColumnMap {
  int64_t rows = 0;   // D: channels * rows of the map, channel by channel
  int64_t width = 0;  // floats from one row to the next
  int64_t first = 0;
  int64_t merged = 1;  // columns of the map per sector
};

class CnnRingPlan {
 public:
  /// Throws what ring_features() throws.
  CnnRingPlan(const RingModel& model, const std::vector<std::string>& layers, int sectors,
              const engine::Net& net, const engine::PlanOptions& forward);
  const std::vector<ColumnMap>& maps() const { return maps_; }

  /// Processes one scan at a time. Refers to the plan.
  class Runner {
   public:
    explicit Runner(const CnnRingPlan& plan);
    void forward(const PointCloud& leveled);
    /// Output for the last scan.
    const float* map(size_t layer) const;
    /// Writes the fraction of a sector's image columns that have a return.
    void seen(std::span<float> weights) const;

   private:
    const CnnRingPlan& plan_;
    engine::Run run_;
    RangeImage image_;
    std::vector<float> continued_;
  };

 private:
  ImageGeometry geometry_;
  std::vector<std::string> layers_;
  int margin_;  // columns of the wrap-around margin on each side
  ImagePlan images_;
  std::vector<ColumnMap> maps_;
};

class ColumnProjection {
 public:
  explicit ColumnProjection(const RingLayer& layer);
  int64_t features() const { return directions_.n; }
  /// Writes x [features][sectors]: the projected columns minus their projected mean.
  void operator()(const ColumnMap& map, const float* values, int sectors, float* ring) const;

 private:
  FloatMatrix directions_;
  std::vector<float> mean_;  // projected
};

/// Computes the polar ring of a gravity-aligned scan whose ground is at -sensor_height: `ring`
/// [grid.features()][sectors] and `seen` [grid.bins()][sectors]. A bin is seen (1, else 0) if it
/// has a return or a ray passed it. Azimuth decreases with the sector.
void polar_ring(const PointCloud& cloud, const RingGrid& grid, double sensor_height,
                std::span<float> ring, std::span<float> seen);

/// FeatureExtractor::key without the precision; identifies image, net and directions.
std::string extraction_key(const RingModel& model);

}  // namespace revisit

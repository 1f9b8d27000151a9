#pragma once

#include <span>
#include <string>
#include <vector>

#include "feature/image_plan.h"
#include "revisit/recognition/feature.h"
#include "revisit/recognition/ring/model.h"

namespace revisit {

/// Columns of a layer's feature map that lie over the range image: `[rows][width]` floats. Column k
/// of the ring is the mean of columns first + k * merged to first + (k + 1) * merged - 1.
struct ColumnMap {
  int64_t rows = 0;   // D: channels * rows of the map, channel by channel
  int64_t width = 0;  // floats from one row to the next
  int64_t first = 0;
  int64_t merged = 1;  // columns of the map per sector
};

class ColumnPlan {
 public:
  /// Throws what ring_features() throws.
  ColumnPlan(const RingModel& model, const std::vector<std::string>& layers, int sectors,
             const engine::Net& net, const Forward& forward);
  const std::vector<ColumnMap>& maps() const { return maps_; }

  /// Processes one scan at a time. Refers to the plan.
  class Runner {
   public:
    explicit Runner(const ColumnPlan& plan);
    void forward(const PointCloud& leveled);
    /// Output for the last scan.
    const float* map(size_t layer) const;
    /// Writes the fraction of a sector's image columns that have a return.
    void seen(std::span<float> weights) const;

   private:
    const ColumnPlan& plan_;
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

class ColumnReduction {
 public:
  explicit ColumnReduction(const LayerColumns& layer);
  int64_t numbers() const { return directions_.n; }
  /// Writes x [features][sectors]: the projected columns minus their projected mean.
  void operator()(const ColumnMap& map, const float* values, int sectors, float* ring) const;

 private:
  FloatMatrix directions_;
  std::vector<float> mean_;  // projected
};

}  // namespace revisit

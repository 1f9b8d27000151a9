#include "layers/box_offsets.h"

#include <algorithm>

#include "revisit/base/error.h"

namespace revisit::engine {

BoxOffsets::BoxOffsets(const caffe::BBoxRegParameter& param) {
  if (param.bbox_mean_size() == 0 || param.bbox_std_size() == 0) return;
  if (param.bbox_mean_size() != 4 || param.bbox_std_size() != 4)
    throw InputError("expected 4 bbox_mean and 4 bbox_std, found ", param.bbox_mean_size(), " and ",
                     param.bbox_std_size());
  std::ranges::copy(param.bbox_mean(), means_.begin());
  std::ranges::copy(param.bbox_std(), deviations_.begin());
  for (const float deviation : deviations_)
    if (!(deviation > 0)) throw InputError("bbox_std must be above 0, found ", deviation);
}

}  // namespace revisit::engine

#pragma once

#include <cstdint>

#include "kernels/suppression.h"

namespace revisit::engine {

/// Corners, in fractions of the image.
struct Box {
  float xmin, ymin, xmax, ymax;
};

/// How four numbers `t`, each times its variance, move a prior box (Liu et al. 2016).
enum class BoxCode {
  kCorner,      // added to the corners
  kCenterSize,  // centre moved by t w, t h; size times exp(t)
  kCornerSize,  // added to the corners in units of the prior's size
};
Box decode_box(const Box& prior, const float variance[4], const float t[4], BoxCode code);

/// Intersection over union; 0 for boxes that do not meet.
float jaccard_overlap(const Box& a, const Box& b);

/// Greedy non-maximum suppression: from the best score down, a candidate is kept unless it overlaps
/// one already kept by more than `threshold`. `threshold` shrinks by the factor `eta` after each
/// box kept, while above 0.5. Keeps them at the front, best first; returns how many. Equal scores
/// go by the lower index. Only the best `top_k` are looked at (-1: all).
int64_t suppress(Candidate* candidates, int64_t n, const Box* boxes, int64_t top_k, float threshold,
                 float eta);

/// SSD's last layer.
struct DetectionProblem {
  int64_t images = 1, priors = 1, classes = 1;
  bool shared_locations = true;  // one box for all classes
  int64_t background = 0;        // a class that is not detected; -1: none
  BoxCode code = BoxCode::kCorner;
  bool variance_in_target = false;  // the network has applied the variances itself
  float confidence_threshold = 0;
  float overlap_threshold = 0.3F, eta = 1;
  int64_t top_k = -1;       // candidates of a class; -1: all
  int64_t keep_top_k = -1;  // detections of an image; -1: all

  int64_t detected_classes() const {
    return classes - (background >= 0 && background < classes ? 1 : 0);
  }
  /// Most detections of one image.
  int64_t most_kept() const;
  /// Most rows of the output.
  int64_t most_rows() const;
  int64_t scratch_floats() const;
};

/// Locations `[image][prior][class or one][4]`, confidences `[image][prior][class]`, priors
/// `[2][prior][4]` (boxes, variances). Writes rows of image, class, score, xmin, ymin, xmax, ymax,
/// ordered by image, then class, then score, and returns how many. When nothing at all is detected,
/// there is one row for each image, of -1 after the image's number.
int64_t detect(const DetectionProblem& problem, const float* locations, const float* confidences,
               const float* priors, float* output, float* scratch);

}  // namespace revisit::engine

#pragma once

#include <algorithm>
#include <cstdint>

namespace revisit::engine {

struct Candidate {
  float score;
  int32_t box;
};

/// Orders best first. Never equal, so std::sort is deterministic without a stable sort's memory.
inline bool is_better(const Candidate& a, const Candidate& b) {
  return a.score != b.score ? a.score > b.score : a.box < b.box;
}

/// Greedy non-maximum suppression of sorted candidates: one is kept unless a kept one
/// `suppresses(kept, candidate)`. Calls `after_each()` after each kept one and ends with the `most`
/// best. Moves the kept ones to the front, in order; returns their number.
template <typename Suppresses, typename AfterEach = void (*)()>
int64_t keep_unsuppressed(
    Candidate* candidates, int64_t n, int64_t most, const Suppresses& suppresses,
    const AfterEach& after_each = [] {}) {
  int64_t kept = 0;
  for (int64_t i = 0; i < n && kept < most; ++i) {
    const Candidate candidate = candidates[i];
    if (std::any_of(candidates, candidates + kept,
                    [&](const Candidate& other) { return suppresses(other, candidate); }))
      continue;
    candidates[kept++] = candidate;
    after_each();
  }
  return kept;
}

/// Corners as fractions of the image size.
struct Box {
  float xmin, ymin, xmax, ymax;
};

/// Four numbers `t`, each multiplied by its variance, move a prior box (Liu et al. 2016).
enum class BoxCode {
  kCorner,      // added to the corners
  kCenterSize,  // center moved by t w, t h; size multiplied by exp(t)
  kCornerSize,  // added to the corners in units of the prior's size
};
Box decode_box(const Box& prior, const float variance[4], const float t[4], BoxCode code);

/// Intersection over union; 0 for disjoint boxes.
float jaccard_overlap(const Box& a, const Box& b);

/// Greedy non-maximum suppression: in order of decreasing score, a candidate is kept unless it
/// overlaps a kept one by more than `threshold`. `threshold` is multiplied by `eta` after each kept
/// box, while above 0.5. Moves the kept ones to the front, best first; returns their number. Equal
/// scores are ordered by index. Only the best `top_k` are considered (-1: all).
int64_t suppress(Candidate* candidates, int64_t n, const Box* boxes, int64_t top_k, float threshold,
                 float eta);

struct DetectionProblem {
  int64_t images = 1, priors = 1, classes = 1;
  bool shared_locations = true;  // one box for all classes
  int64_t background = 0;        // class that is ignored; -1: none
  BoxCode code = BoxCode::kCorner;
  bool variance_in_target = false;  // the network's outputs include the variances
  bool clip = false;                // boxes end at the borders of the image
  float confidence_threshold = 0;
  float overlap_threshold = 0.3F, eta = 1;
  int64_t top_k = -1;       // candidates per class; -1: all
  int64_t keep_top_k = -1;  // detections per image; -1: all
  float objectness = 0;     // see Refinement

  int64_t detected_classes() const {
    return classes - (background >= 0 && background < classes ? 1 : 0);
  }
  int64_t most_kept() const;
  int64_t most_rows() const;
  int64_t scratch_floats() const;
};

/// RefineDet's first stage: confidences `[image][prior][2]`, and locations `[image][prior][4]` that
/// move the prior boxes; both may be null. A prior box whose second confidence is below
/// `objectness` has confidence 1 for class 0, and 0 for the others.
struct Refinement {
  const float *confidences = nullptr, *locations = nullptr;
};

/// Locations `[image][prior][class or one][4]`, confidences `[image][prior][class]`, priors
/// `[2][prior][4]` (boxes, variances). Writes rows of image, class, score, xmin, ymin, xmax, ymax,
/// ordered by image, class and score, and returns their number. Without any detection, writes one
/// row per image: its index, then -1.
int64_t detect(const DetectionProblem& problem, const float* locations, const float* confidences,
               const float* priors, const Refinement& first, float* output, float* scratch);

}  // namespace revisit::engine

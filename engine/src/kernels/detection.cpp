#include "kernels/detection.h"

#include <algorithm>
#include <cmath>

namespace revisit::engine {
namespace {

constexpr int64_t kRow = 7;  // floats per detection

float area(const Box& box) {
  if (box.xmax < box.xmin || box.ymax < box.ymin) return 0;
  return (box.xmax - box.xmin) * (box.ymax - box.ymin);
}

struct Detection {
  float score;
  int32_t box, label, order;  // order: index by class, then by score
};

int64_t max_candidates(const DetectionProblem& p) {
  return p.top_k >= 0 ? std::min(p.top_k, p.priors) : p.priors;
}

struct Scratch {
  Box* boxes;             // [class or one][prior]
  Candidate* candidates;  // [prior]
  Detection* detections;  // [detected class * candidate]
};

int64_t location_classes(const DetectionProblem& p) {
  return p.shared_locations ? 1 : p.classes;
}

Scratch divide(const DetectionProblem& p, float* scratch) {
  auto* boxes = reinterpret_cast<Box*>(scratch);
  auto* candidates = reinterpret_cast<Candidate*>(boxes + location_classes(p) * p.priors);
  return {boxes, candidates, reinterpret_cast<Detection*>(candidates + p.priors)};
}

Box clipped(const Box& box) {
  return {std::clamp(box.xmin, 0.F, 1.F), std::clamp(box.ymin, 0.F, 1.F),
          std::clamp(box.xmax, 0.F, 1.F), std::clamp(box.ymax, 0.F, 1.F)};
}

/// `first`: locations that move the priors before, or null.
void decode_boxes(const DetectionProblem& p, const float* locations, const float* priors,
                  const float* first, Box* boxes) {
  constexpr float kApplied[4] = {1, 1, 1, 1};
  const int64_t per_prior = location_classes(p);
  for (int64_t i = 0; i < p.priors; ++i) {
    const float* prior = priors + 4 * i;
    const float* variance = p.variance_in_target ? kApplied : priors + 4 * (p.priors + i);
    Box moved{prior[0], prior[1], prior[2], prior[3]};
    if (first) moved = decode_box(moved, variance, first + 4 * i, p.code);
    for (int64_t c = 0; c < per_prior; ++c) {
      const Box box = decode_box(moved, variance, locations + 4 * (i * per_prior + c), p.code);
      boxes[c * p.priors + i] = p.clip ? clipped(box) : box;
    }
  }
}

/// `first`: confidences of RefineDet's first stage, or null.
int64_t detect_in_image(const DetectionProblem& p, const float* confidences, const float* first,
                        const Scratch& s) {
  int64_t found = 0;
  for (int64_t label = 0; label < p.classes; ++label) {
    if (label == p.background) continue;
    const Box* boxes = s.boxes + (p.shared_locations ? 0 : label * p.priors);
    int64_t n = 0;
    for (int64_t i = 0; i < p.priors; ++i) {
      float score = confidences[i * p.classes + label];
      if (first && first[2 * i + 1] < p.objectness) score = label == 0 ? 1 : 0;
      if (score > p.confidence_threshold) s.candidates[n++] = {score, static_cast<int32_t>(i)};
    }
    const int64_t kept = suppress(s.candidates, n, boxes, p.top_k, p.overlap_threshold, p.eta);
    for (int64_t i = 0; i < kept; ++i, ++found)
      s.detections[found] = {s.candidates[i].score, s.candidates[i].box,
                             static_cast<int32_t>(label), static_cast<int32_t>(found)};
  }
  if (p.keep_top_k >= 0 && found > p.keep_top_k) {
    const auto by_order = [](const Detection& a, const Detection& b) { return a.order < b.order; };
    std::sort(s.detections, s.detections + found, [&](const Detection& a, const Detection& b) {
      return a.score != b.score ? a.score > b.score : by_order(a, b);
    });
    found = p.keep_top_k;
    std::sort(s.detections, s.detections + found, by_order);
  }
  return found;
}

}  // namespace

Box decode_box(const Box& prior, const float variance[4], const float t[4], BoxCode code) {
  const float width = prior.xmax - prior.xmin, height = prior.ymax - prior.ymin;
  switch (code) {
    case BoxCode::kCorner:
      return {prior.xmin + variance[0] * t[0], prior.ymin + variance[1] * t[1],
              prior.xmax + variance[2] * t[2], prior.ymax + variance[3] * t[3]};
    case BoxCode::kCornerSize:
      return {prior.xmin + variance[0] * t[0] * width, prior.ymin + variance[1] * t[1] * height,
              prior.xmax + variance[2] * t[2] * width, prior.ymax + variance[3] * t[3] * height};
    case BoxCode::kCenterSize:
      break;
  }
  const float x = variance[0] * t[0] * width + (prior.xmin + prior.xmax) / 2;
  const float y = variance[1] * t[1] * height + (prior.ymin + prior.ymax) / 2;
  const float w = std::exp(variance[2] * t[2]) * width, h = std::exp(variance[3] * t[3]) * height;
  return {x - w / 2, y - h / 2, x + w / 2, y + h / 2};
}

float jaccard_overlap(const Box& a, const Box& b) {
  if (b.xmin > a.xmax || b.xmax < a.xmin || b.ymin > a.ymax || b.ymax < a.ymin) return 0;
  const float width = std::min(a.xmax, b.xmax) - std::max(a.xmin, b.xmin);
  const float height = std::min(a.ymax, b.ymax) - std::max(a.ymin, b.ymin);
  if (!(width > 0 && height > 0)) return 0;
  const float both = width * height;
  return both / (area(a) + area(b) - both);
}

int64_t suppress(Candidate* candidates, int64_t n, const Box* boxes, int64_t top_k, float threshold,
                 float eta) {
  std::sort(candidates, candidates + n, is_better);
  if (top_k >= 0) n = std::min(n, top_k);
  return keep_unsuppressed(
      candidates, n, n,
      [&](const Candidate& kept, const Candidate& candidate) {
        return !(jaccard_overlap(boxes[candidate.box], boxes[kept.box]) <= threshold);
      },
      [&] {
        if (eta < 1 && threshold > 0.5F) threshold *= eta;
      });
}

int64_t DetectionProblem::most_kept() const {
  const int64_t most = detected_classes() * max_candidates(*this);
  return keep_top_k >= 0 ? std::min(keep_top_k, most) : most;
}

int64_t DetectionProblem::most_rows() const {
  return images * std::max<int64_t>(most_kept(), 1);
}

int64_t DetectionProblem::scratch_floats() const {
  const int64_t bytes =
      location_classes(*this) * priors * static_cast<int64_t>(sizeof(Box)) +
      priors * static_cast<int64_t>(sizeof(Candidate)) +
      detected_classes() * max_candidates(*this) * static_cast<int64_t>(sizeof(Detection));
  return bytes / static_cast<int64_t>(sizeof(float));
}

int64_t detect(const DetectionProblem& p, const float* locations, const float* confidences,
               const float* priors, const Refinement& first, float* output, float* scratch) {
  const Scratch s = divide(p, scratch);
  const auto of_image = [&](const float* values, int64_t image, int64_t per_prior) {
    return values ? values + image * p.priors * per_prior : nullptr;
  };
  int64_t rows = 0;
  for (int64_t image = 0; image < p.images; ++image) {
    decode_boxes(p, locations + image * p.priors * location_classes(p) * 4, priors,
                 of_image(first.locations, image, 4), s.boxes);
    const int64_t found = detect_in_image(p, confidences + image * p.priors * p.classes,
                                          of_image(first.confidences, image, 2), s);
    for (int64_t i = 0; i < found; ++i, ++rows) {
      const Detection& d = s.detections[i];
      const Box& box = s.boxes[(p.shared_locations ? 0 : d.label * p.priors) + d.box];
      const auto number = static_cast<float>(image), label = static_cast<float>(d.label);
      const float row[kRow] = {number, label, d.score, box.xmin, box.ymin, box.xmax, box.ymax};
      std::copy_n(row, kRow, output + rows * kRow);
    }
  }
  if (rows > 0) return rows;
  for (int64_t image = 0; image < p.images; ++image) {
    std::fill_n(output + image * kRow, kRow, -1.0F);
    output[image * kRow] = static_cast<float>(image);
  }
  return p.images;
}

}  // namespace revisit::engine

#include <algorithm>
#include <cmath>
#include <limits>

#include "kernels/detection.h"
#include "layers/layers.h"

namespace revisit::engine {
namespace {

/// Corners [pixels], both inclusive.
struct Region {
  float x1, y1, x2, y2;

  float width() const { return x2 - x1 + 1; }
  float height() const { return y2 - y1 + 1; }
  float area() const { return width() * height(); }
};

/// Orders by decreasing score, NaN last, equal scores by row, column and anchor.
bool scores_higher(const Candidate& a, const Candidate& b) {
  const auto key = [](float score) {
    return std::isnan(score) ? -std::numeric_limits<float>::infinity() : score;
  };
  return key(a.score) != key(b.score) ? key(a.score) > key(b.score) : a.box < b.box;
}

/// Parameters of a Proposal layer (Ren et al. 2015): `anchors` at each pixel of an h x w map.
struct ProposalProblem {
  std::vector<Region> anchors;
  int64_t h = 1, w = 1;
  float stride = 16, min_size = 16;
  int64_t max_before = 6000, max_after = 300;  // regions before and after suppression
  float overlap_threshold = 0.7F;
  bool has_two_scales = false;  // values 2 and 3 of the image are its scales along y and x
  bool drops_small = false;     // otherwise small regions get score 0

  int64_t regions() const { return h * w * static_cast<int64_t>(anchors.size()); }
  int64_t scratch_floats() const { return regions() * 6; }
};

/// Moves an anchor by `t` (4 numbers, `step` apart); the result is not clipped.
Region moved(const Region& anchor, float x, float y, const float* t, int64_t step) {
  const Region box{x + anchor.x1, y + anchor.y1, x + anchor.x2, y + anchor.y2};
  const float w = box.width(), h = box.height();
  const float center_x = t[0] * w + (box.x1 + 0.5F * w);
  const float center_y = t[step] * h + (box.y1 + 0.5F * h);
  const float half_w = 0.5F * (std::exp(t[2 * step]) * w);
  const float half_h = 0.5F * (std::exp(t[3 * step]) * h);
  return {center_x - half_w, center_y - half_h, center_x + half_w, center_y + half_h};
}

/// NaN becomes 0, as in the C++ sources.
float clipped(float v, float size) {
  return std::max(0.0F, std::min(v, size - 1));
}

bool has_nan(const Region& r) {
  return std::isnan(r.x1) || std::isnan(r.y1) || std::isnan(r.x2) || std::isnan(r.y2);
}

int64_t decode(const ProposalProblem& p, const float* scores, const float* offsets,
               const float* image, Region* regions, Candidate* scored) {
  const int64_t area = p.h * p.w, n_anchors = static_cast<int64_t>(p.anchors.size());
  const float min_h = p.min_size * image[2],
              min_w = p.has_two_scales ? p.min_size * image[3] : min_h;
  Candidate* end = scored;
  int32_t index = 0;
  for (int64_t pixel = 0; pixel < area; ++pixel)
    for (int64_t a = 0; a < n_anchors; ++a, ++index) {
      const int64_t row = pixel / p.w, column = pixel % p.w;
      const Region box =
          moved(p.anchors[a], static_cast<float>(column) * p.stride,
                static_cast<float>(row) * p.stride, offsets + a * 4 * area + pixel, area);
      const Region cut{clipped(box.x1, image[1]), clipped(box.y1, image[0]),
                       clipped(box.x2, image[1]), clipped(box.y2, image[0])};
      regions[index] = cut;
      const bool is_large = cut.width() >= min_w && cut.height() >= min_h;
      if (p.drops_small && (!is_large || has_nan(box))) continue;
      const float score = scores[(n_anchors + a) * area + pixel];
      *end++ = {is_large ? score : 0 * score, index};
    }
  return end - scored;
}

float overlap(const Region& a, const Region& b) {
  const float w = std::max(0.0F, std::min(a.x2, b.x2) - std::max(a.x1, b.x1) + 1);
  const float h = std::max(0.0F, std::min(a.y2, b.y2) - std::max(a.y1, b.y1) + 1);
  const float common = w * h;
  return common / (a.area() + b.area() - common);
}

/// Writes rows of 0, x1, y1, x2, y2, best first, and their scores (may be null); returns their
/// number. `scores` is `[2][anchor][h][w]`, where the second half is objectness, `offsets` is
/// `[anchor][4][h][w]`, `image` has height, width and scale.
int64_t propose(const ProposalProblem& p, const float* scores, const float* offsets,
                const float* image, float* rows, float* row_scores, float* scratch) {
  auto* const regions = reinterpret_cast<Region*>(scratch);
  auto* const scored = reinterpret_cast<Candidate*>(scratch + p.regions() * 4);
  const int64_t n_scored = decode(p, scores, offsets, image, regions, scored);
  const int64_t n = std::min(n_scored, p.max_before);
  std::partial_sort(scored, scored + n, scored + n_scored, scores_higher);
  const int64_t n_kept = keep_unsuppressed(
      scored, n, p.max_after, [&](const Candidate& better, const Candidate& other) {
        return overlap(regions[better.box], regions[other.box]) > p.overlap_threshold;
      });
  for (int64_t i = 0; i < n_kept; ++i) {
    const Region& region = regions[scored[i].box];
    const float row[] = {0, region.x1, region.y1, region.x2, region.y2};
    std::copy_n(row, 5, rows + i * 5);
    if (row_scores) row_scores[i] = scored[i].score;
  }
  return n_kept;
}

/// Regions of interest from scores and offsets of anchors: proposal_layer.cpp of luoyetx/mini-caffe
/// and happynear/caffe-windows. With a `python_param` it replaces lib/rpn/proposal_layer.py of
/// rbgirshick/py-faster-rcnn, which drops small regions. FrcnnProposal of makefile/frcnn does so,
/// too; its settings are in a file of its own.
class Proposal : public Layer {
 public:
  explicit Proposal(const caffe::LayerParameter& layer)
      : param_(layer.proposal_param()),
        is_of_python_(layer.has_python_param() || layer.type() == "FrcnnProposal") {
    const auto is_size = [](float size) { return size > 0 && std::isfinite(size); };
    if (layer.type() == "FrcnnProposal" && param_.anchor().empty() && param_.ratio().empty())
      throw InputError(
          "its anchors and settings are in the JSON file of makefile/frcnn; add them: "
          "proposal_param { feat_stride: 16 min_size: 16 pre_nms_topn: 6000 "
          "post_nms_topn: 300 nms_thresh: 0.7 anchor: -84 anchor: -40 anchor: 99 "
          "anchor: 55 ... } (the values test_rpn_..., and each number of anchors)");
    if (param_.anchor_size() % 4 != 0 ||
        !std::ranges::all_of(param_.anchor(), [](float corner) { return std::isfinite(corner); }))
      throw InputError("anchor: expected 4 numbers for each anchor, found ", param_.anchor_size());
    if (!param_.anchor().empty() && param_.ratio_size() + param_.scale_size() > 0)
      throw InputError("give anchor, or ratio and scale, not both");
    if (param_.anchor().empty() && (param_.ratio().empty() || param_.scale().empty() ||
                                    !std::ranges::all_of(param_.ratio(), is_size) ||
                                    !std::ranges::all_of(param_.scale(), is_size)))
      throw InputError("ratio and scale must be given, and be finite and above 0");
    if (param_.feat_stride() < 1 || param_.base_size() < 1)
      throw InputError("feat_stride and base_size must be at least 1");
    if (param_.pre_nms_topn() < 1 || param_.post_nms_topn() < 1)
      throw InputError("pre_nms_topn and post_nms_topn must be at least 1");
    if (!(param_.nms_thresh() >= 0)) throw InputError("nms_thresh must not be negative");
  }

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    expect_count(inputs.size(), 3, "inputs (scores, offsets, the image's size and scale)");
    expect_1_or_2(n_outputs, "outputs (regions, their scores)");
    const Shape &scores = inputs[0], &offsets = inputs[1], &image = inputs[2];
    const int64_t anchors = param_.anchor().empty()
                                ? int64_t{param_.ratio_size()} * param_.scale_size()
                                : int64_t{param_.anchor_size()} / 4;
    if (scores.rank() != 4 || scores[0] != 1 || scores[1] != 2 * anchors)
      throw InputError("expected scores of shape 1 x ", 2 * anchors, " x h x w for ", anchors,
                       " anchors (ratios x scales) of one image, found ", scores);
    if (offsets != scores.with(1, 4 * anchors))
      throw InputError("expected offsets of shape ", scores.with(1, 4 * anchors), ", found ",
                       offsets);
    if (image.elements() < 3)
      throw InputError("expected height, width and scale of the image, found ", image);
    expect_int(scores.elements() / 2, "the number of regions");
    const int64_t most = std::min(
        {scores.elements() / 2, int64_t{param_.pre_nms_topn()}, int64_t{param_.post_nms_topn()}});
    if (n_outputs == 1) return {Shape{most, 5}};
    return {Shape{most, 5}, is_of_python_ ? Shape{most, 1} : Shape{most}};
  }

  std::optional<size_t> dynamic_axis() const override { return 0; }

  Kernel bind(const Binding& binding) const override {
    const Shape& scores = binding.inputs[0];
    ProposalProblem p{anchors(), scores[2], scores[3]};
    p.stride = static_cast<float>(param_.feat_stride());
    p.min_size = static_cast<float>(param_.min_size());
    p.max_before = param_.pre_nms_topn(), p.max_after = binding.outputs[0][0];
    p.overlap_threshold = param_.nms_thresh();
    p.has_two_scales = !is_of_python_ && binding.inputs[2].elements() > 3;
    p.drops_small = is_of_python_;
    const Bytes scratch = floats(p.scratch_floats());
    return {"decode-suppress",
            [p = std::move(p)](const Call& call) {
              *call.rows =
                  propose(p, call.inputs[0], call.inputs[1], call.inputs[2], call.outputs[0],
                          call.outputs.size() > 1 ? call.outputs[1] : nullptr, call.scratch);
            },
            scratch};
  }

 private:
  /// Boxes with the area of the base, for each ratio of height to width and each scale.
  std::vector<Region> anchors() const {
    const auto base = static_cast<float>(param_.base_size());
    const float center = 0.5F * (base - 1);
    std::vector<Region> anchors;
    for (int i = 0; i + 3 < param_.anchor_size(); i += 4)
      anchors.push_back(
          {param_.anchor(i), param_.anchor(i + 1), param_.anchor(i + 2), param_.anchor(i + 3)});
    for (const float ratio : param_.ratio()) {
      const float w = std::round(std::sqrt(base * base / ratio)), h = std::round(w * ratio);
      for (const float scale : param_.scale()) {
        const float half_w = 0.5F * (w * scale - 1), half_h = 0.5F * (h * scale - 1);
        anchors.push_back({center - half_w, center - half_h, center + half_w, center + half_h});
      }
    }
    return anchors;
  }

  caffe::ProposalParameter param_;
  bool is_of_python_;
};

}  // namespace

constinit const LayerEntries kProposalLayers = {
    {"FrcnnProposal", make<Proposal>, "makefile/frcnn", "a Proposal with given anchors"},
    {"Proposal", make<Proposal>, "Faster R-CNN", "regions from scores and offsets of anchors"},
};

}  // namespace revisit::engine

#include "kernels/detection.h"

#include "single_layer.h"
#include "testing.h"

namespace revisit::engine {
namespace {

TEST(Normalize, OverChannelsOrTheWholeImage) {
  const Tensor image{Shape{1, 2, 1, 2}, {3, 0, 4, 5}};
  const auto pixels = run_layer({"Normalize",
                                 "norm_param { across_spatial: false channel_shared: false }",
                                 {image},
                                 {{10, 20}}});
  expect_near(pixels[0].values, {6, 0, 16, 20}, 1e-5F);
  const auto whole = run_layer({"Normalize", "", {image}, {{2}}});
  const float norm = std::sqrt(50.0F);
  expect_near(whole[0].values, {6 / norm, 0, 8 / norm, 10 / norm}, 1e-6F);
}

TEST(Normalize, EpsilonKeepsZeroFromDividing) {
  const auto found = run_layer({"Normalize",
                                "norm_param { across_spatial: false eps: 4 }",
                                {{Shape{2, 1, 1, 1}, {0, 1}}},
                                {{1}}});
  expect_near(found[0].values, {0, 1 / std::sqrt(5.0F)}, 1e-7F);
}

TEST(Normalize, MayOverwriteItsInput) {
  for (const std::string across : {"true", "false"}) {
    const Tensor image{Shape{2, 3, 20, 30}, test::random_floats(2 * 3 * 20 * 30, 3)};
    test::SingleLayer layer{"Normalize",
                            "norm_param { channel_shared: false across_spatial: " + across + " }",
                            {image},
                            {{1, 2, 3}}};
    const auto apart = run_layer(layer)[0].values;
    layer.in_place = true;
    EXPECT_EQ(run_layer(layer)[0].values, apart) << across;
  }
}

TEST(Normalize, SameForAnyNumberOfThreads) {
  const Tensor image{Shape{2, 5, 30, 31}, test::random_floats(2 * 5 * 930, 1)};
  for (const std::string across : {"false", "true"}) {
    test::SingleLayer l{
        "Normalize", "norm_param { across_spatial: " + across + " }", {image}, {{3}}};
    const auto one = run_layer(l)[0].values;
    l.threads = 3;
    EXPECT_EQ(run_layer(l)[0].values, one);
  }
}

/// Of NormFace: every pixel by its own norm and without weights, also at the field's first place.
TEST(Normalize, OfNormFaceHasNoWeights) {
  const Tensor image{Shape{1, 2, 1, 2}, {3, 0, 4, 1e-3F}};
  const std::vector<float> wanted{0.6F, 0, 0.8F, std::sqrt(0.5F)};  // eps 1e-6 doubles the last sum
  for (const std::string param : {"normalize_param { }", "normalize_param { normalize_type: 'L2' }",
                                  "softmax_param { normalize_type: 'L2' }"})
    expect_near(run_layer({"Normalize", param, {image}})[0].values, wanted, 1e-6F);
  expect_rejected<UnsupportedError>("Normalize", "normalize_param { normalize_type: 'L1' }",
                                    {image.shape}, {"'L1'"});
  expect_rejected<UnsupportedError>("Softmax", "softmax_param { normalize_type: 'L2' }",
                                    {image.shape}, {"'L2'"});
}

TEST(PriorBox, ByHand) {
  // A 1x2 map on an image of 20 x 40 pixels: steps 20 and 20, centers (10, 10) and (30, 10).
  const auto found =
      run_layer({"PriorBox",
                 "prior_box_param { min_size: 4 max_size: 9 aspect_ratio: 4 "
                 "aspect_ratio: 1 variance: [0.1, 0.1, 0.2, 0.2] }",
                 {{Shape{1, 1, 1, 2}, {0, 0}}, {Shape{1, 1, 20, 40}, std::vector<float>(800)}}});
  EXPECT_EQ(found[0].shape, (Shape{1, 2, 2 * 4 * 4}));
  // 4 x 4, sqrt(4 * 9) = 6 x 6, 4 * 2 x 4 / 2, and flipped.
  const std::vector<float> cell{8, 8, 12, 12, 7, 7, 13, 13, 6, 9, 14, 11, 9, 6, 11, 14};
  std::vector<float> wanted;
  for (const float shift : {0.0F, 20.0F})
    for (size_t i = 0; i < cell.size(); ++i)
      wanted.push_back(i % 2 == 0 ? (cell[i] + shift) / 40 : cell[i] / 20);
  for (int i = 0; i < 8; ++i) wanted.insert(wanted.end(), {0.1F, 0.1F, 0.2F, 0.2F});
  expect_near(found[0].values, wanted, 1e-6F);
}

TEST(PriorBox, SizesAreIntegersAndClippedOnDemand) {
  // SSD truncates 5.9 to 5; with img_size 10, step 10, offset 0 the box is centered on the corner.
  const std::vector<Tensor> inputs{{Shape{1, 1, 1, 1}, {0}}, {Shape{1, 1, 1, 1}, {0}}};
  const std::string param = "min_size: 5.9 img_size: 10 step: 10 offset: 0 variance: 0.5";
  expect_near(run_layer({"PriorBox", "prior_box_param { " + param + " }", inputs})[0].values,
              {-0.25F, -0.25F, 0.25F, 0.25F, 0.5F, 0.5F, 0.5F, 0.5F});
  expect_near(
      run_layer({"PriorBox", "prior_box_param { " + param + " clip: true }", inputs})[0].values,
      {0, 0, 0.25F, 0.25F, 0.5F, 0.5F, 0.5F, 0.5F});
}

TEST(PriorBoxClustered, ByHand) {
  // A 1x2 map on an image of 20 x 40 pixels: centers (10, 10) and (30, 10). Sizes stay fractions.
  const auto found =
      run_layer({"PriorBoxClustered",
                 "prior_box_param { width: 4 height: 8 width: 2.5 height: 1 variance: 0.5 }",
                 {{Shape{1, 1, 1, 2}, {0, 0}}, {Shape{1, 1, 20, 40}, std::vector<float>(800)}}});
  EXPECT_EQ(found[0].shape, (Shape{1, 2, 2 * 2 * 4}));
  std::vector<float> wanted{8.0F / 40,   6.0F / 20, 12.0F / 40,  14.0F / 20,
                            8.75F / 40,  9.5F / 20, 11.25F / 40, 10.5F / 20,
                            28.0F / 40,  6.0F / 20, 32.0F / 40,  14.0F / 20,
                            28.75F / 40, 9.5F / 20, 31.25F / 40, 10.5F / 20};
  wanted.insert(wanted.end(), 16, 0.5F);
  expect_near(found[0].values, wanted, 1e-6F);
}

TEST(PriorBoxClustered, RejectsInvalidParameters) {
  const auto make = [](const std::string& type, const std::string& param) {
    return [=] { layer_of(type, "prior_box_param { " + param + " }"); };
  };
  expect_error<InputError>(make("PriorBoxClustered", "width: 4"), {"as many height as width"});
  expect_error<InputError>(make("PriorBoxClustered", "width: 0 height: 4"), {"above 0"});
  expect_error<InputError>(make("PriorBoxClustered", "min_size: 3"), {"not min_size"});
  expect_error<InputError>(make("PriorBox", "min_size: 3 width: 4"), {"PriorBoxClustered"});
}

TEST(PriorBox, RejectsInvalidParameters) {
  const auto make = [](const std::string& param) {
    return [=] { layer_of("PriorBox", "prior_box_param { " + param + " }"); };
  };
  expect_error<InputError>(make(""), {"min_size"});
  expect_error<InputError>(make("min_size: nan"), {"min_size"});
  expect_error<InputError>(make("min_size: 4 max_size: 4"), {"larger than min_size"});
  expect_error<InputError>(make("min_size: 4 min_size: 5 max_size: 9"), {"one max_size"});
  expect_error<InputError>(make("min_size: 4 aspect_ratio: 0"), {"aspect_ratio"});
  expect_error<InputError>(make("min_size: 4 variance: [1, 2]"), {"1 or 4 variances"});
  expect_error<InputError>(make("min_size: 4 img_h: 2"), {"together"});
  expect_error<InputError>(make("min_size: 4 step: 1 step_h: 2 step_w: 2"), {"not both"});
}

/// A few lines of text must not exhaust the machine's memory.
TEST(PriorBox, RefusesMoreBoxesThanAnyDetectorHas) {
  const auto make = [](int n_sizes, int n_ratios) {
    std::string param;
    for (int i = 0; i < n_sizes; ++i) param += "min_size: 4 ";
    for (int i = 0; i < n_ratios; ++i) param += str("aspect_ratio: ", 2 + i, " ");
    return layer_of("PriorBox", "prior_box_param { " + param + " }");
  };
  make(1000, 4);
  make(4, 1000);
  expect_error<InputError>([&] { make(1001, 0); }, {"1000 min_size", "found 1001"});
  expect_error<InputError>([&] { make(1, 1001); }, {"1000 aspect_ratio", "found 1001"});
  expect_error<InputError>([&] { make(1000, 5); }, {"10000 boxes", "found 11000"});
}

TEST(Detection, BoxesAreDecodedInThreeWays) {
  const Box prior{0, 0, 2, 4};
  const float variance[] = {0.5F, 0.5F, 1, 1}, t[] = {1, 2, 0, std::log(2.0F)};
  const auto corners = [](const Box& box) {
    return std::vector<float>{box.xmin, box.ymin, box.xmax, box.ymax};
  };
  expect_near(corners(decode_box(prior, variance, t, BoxCode::kCorner)),
              {0.5F, 1, 2, 4 + std::log(2.0F)}, 1e-6F);
  expect_near(corners(decode_box(prior, variance, t, BoxCode::kCornerSize)),
              {1, 4, 2, 4 + 4 * std::log(2.0F)}, 1e-6F);
  // Center (1, 2) moves by (0.5 * 1 * 2, 0.5 * 2 * 4); 2 x 4 becomes 2 x 8.
  expect_near(corners(decode_box(prior, variance, t, BoxCode::kCenterSize)), {1, 2, 3, 10}, 1e-6F);
}

TEST(Detection, OverlapOfBoxes) {
  EXPECT_FLOAT_EQ(jaccard_overlap({0, 0, 2, 2}, {1, 0, 3, 2}), 1.0F / 3);
  EXPECT_EQ(jaccard_overlap({0, 0, 1, 1}, {2, 2, 3, 3}), 0);
  EXPECT_EQ(jaccard_overlap({0, 0, 1, 1}, {1, 0, 2, 1}), 0);  // they touch
  EXPECT_EQ(jaccard_overlap({1, 1, 0, 0}, {0, 0, 1, 1}), 0);  // inside out
}

TEST(Detection, SuppressesOverlappingBoxes) {
  const Box boxes[] = {{0, 0, 10, 10}, {1, 0, 11, 10}, {20, 0, 30, 10}, {0, 0, 10, 9}};
  const auto kept = [&](int64_t top_k, float threshold, float eta) {
    Candidate candidates[] = {{0.5F, 0}, {0.9F, 1}, {0.5F, 2}, {0.4F, 3}};
    const int64_t n = suppress(candidates, 4, boxes, top_k, threshold, eta);
    std::vector<int> indices;
    for (int64_t i = 0; i < n; ++i) indices.push_back(candidates[i].box);
    return indices;
  };
  EXPECT_EQ(kept(-1, 0.5F, 1), (std::vector<int>{1, 2}));
  EXPECT_EQ(kept(2, 0.5F, 1), (std::vector<int>{1}));
  EXPECT_EQ(kept(-1, 0.85F, 1), (std::vector<int>{1, 0, 2}));  // overlaps: 9 / 11, then 9 / 10
  EXPECT_EQ(kept(-1, 1, 1), (std::vector<int>{1, 0, 2, 3}));
  EXPECT_EQ(kept(-1, 1, 0.9F), (std::vector<int>{1, 0, 2}));  // 1, 0.9, 0.81, 0.729
}

/// Two priors, far apart, and one on the first; 3 classes of which 0 is the background.
test::SingleLayer detector(const std::string& more = "") {
  const std::vector<float> priors{0, 0, 1, 1, 2, 2, 3, 3, 0, 0, 1, 1,  //
                                  1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1};
  return {"DetectionOutput",
          "detection_output_param { num_classes: 3 nms_param { nms_threshold: 0.5 } " + more + " }",
          {{Shape{2, 12}, std::vector<float>(24, 0)},
           {Shape{2, 9},
            {0, 0.9F, 0.1F, 0, 0.2F, 0.3F, 0, 0.5F, 0.6F,  //
             0, 0, 0, 0, 0, 0.7F, 0, 0, 0}},
           {Shape{1, 2, 12}, priors}}};
}

TEST(DetectionOutput, RowsByImageClassAndScore) {
  const auto found = run_layer(detector("confidence_threshold: 0.15"));
  EXPECT_EQ(found[0].shape, (Shape{1, 1, 5, 7}));
  expect_near(found[0].values, {0, 1, 0.9F, 0, 0, 1, 1,  // 0.5 on the same place is suppressed
                                0, 1, 0.2F, 2, 2, 3, 3,  //
                                0, 2, 0.6F, 0, 0, 1, 1,  //
                                0, 2, 0.3F, 2, 2, 3, 3,  //
                                1, 2, 0.7F, 2, 2, 3, 3});
}

TEST(DetectionOutput, KeepsTheBestOfAnImage) {
  const auto found = run_layer(detector("confidence_threshold: 0.15 keep_top_k: 2"));
  expect_near(found[0].values, {0, 1, 0.9F, 0, 0, 1, 1,  //
                                0, 2, 0.6F, 0, 0, 1, 1,  //
                                1, 2, 0.7F, 2, 2, 3, 3});
}

TEST(DetectionOutput, NothingIsARowOfMinusOnesForEachImage) {
  for (const std::string more : {"confidence_threshold: 2", "keep_top_k: 0"}) {
    const auto found = run_layer(detector(more));
    EXPECT_EQ(found[0].shape, (Shape{1, 1, 2, 7}));
    expect_near(found[0].values, {0, -1, -1, -1, -1, -1, -1, 1, -1, -1, -1, -1, -1, -1});
  }
}

TEST(DetectionOutput, NanIsNeverDetected) {
  auto l = detector("confidence_threshold: 0.15");
  l.inputs[1].values[1] = kNan;                                 // the 0.9
  expect_near(run_layer(l)[0].values, {0, 1, 0.5F, 0, 0, 1, 1,  //
                                       0, 1, 0.2F, 2, 2, 3, 3,  //
                                       0, 2, 0.6F, 0, 0, 1, 1,  //
                                       0, 2, 0.3F, 2, 2, 3, 3,  //
                                       1, 2, 0.7F, 2, 2, 3, 3});
}

TEST(DetectionOutput, LocationsOfEachClass) {
  // One prior, two classes, no background: locations [class][4], added to the corners.
  const auto found = run_layer({"DetectionOutput",
                                "detection_output_param { num_classes: 2 share_location: false "
                                "background_label_id: -1 variance_encoded_in_target: true }",
                                {{Shape{1, 8}, {1, 0, 0, 0, 0, 0, 0, 5}},
                                 {Shape{1, 2}, {0.25F, 0.5F}},
                                 {Shape{1, 2, 4}, {0, 0, 2, 2, 9, 9, 9, 9}}}});
  expect_near(found[0].values, {0, 0, 0.25F, 1, 0, 2, 2, 0, 1, 0.5F, 0, 0, 2, 7});
}

TEST(DetectionOutput, RejectsInvalidParameters) {
  expect_error<InputError>([] { layer_of("DetectionOutput", ""); }, {"num_classes"});
  expect_rejected("DetectionOutput",
                  "detection_output_param { num_classes: 2 nms_param { eta: 0 } }", {}, {"eta"});
  EXPECT_NO_THROW(
      layer_of("DetectionOutput",
               "detection_output_param { num_classes: 2 nms_param { soft_nms: false theta: 1 } }"));
  expect_rejected("DetectionOutput",
                  "detection_output_param { num_classes: 2 nms_param { soft_nms: true } }", {},
                  {"soft_nms"});
  const auto infer = [](std::vector<Shape> inputs) {
    return [=] {
      layer_of("DetectionOutput", "detection_output_param { num_classes: 3 }")->infer(inputs, 1);
    };
  };
  expect_error<InputError>(infer({Shape{2, 8}, Shape{2, 6}, Shape{1, 2, 9}}), {"1 x 2 x", "1x2x9"});
  expect_error<InputError>(infer({Shape{2, 9}, Shape{2, 6}, Shape{1, 2, 8}}),
                           {"8 locations", "2 prior boxes", "2x9"});
  expect_error<InputError>(infer({Shape{2, 8}, Shape{2, 7}, Shape{1, 2, 8}}),
                           {"2 x 6 confidences", "2x7"});
}

TEST(RoiPooling, ByHand) {
  // 4 x 4 of 0..15; regions: the whole image at scale 1/2, one pixel, one outside.
  std::vector<float> image(16);
  for (size_t i = 0; i < image.size(); ++i) image[i] = static_cast<float>(i);
  const auto found =
      run_layer({"ROIPooling",
                 "roi_pooling_param { pooled_h: 2 pooled_w: 2 spatial_scale: 0.5 }",
                 {{Shape{1, 1, 4, 4}, image},
                  {Shape{3, 5}, {0, 0, 0, 6, 6, 0, 2, 4, 2, 4, 0, 20, 20, 30, 30}}}});
  EXPECT_EQ(found[0].shape, (Shape{3, 1, 2, 2}));
  // The second is pixel (1, 2), half a pixel to a bin: each takes it whole.
  expect_near(found[0].values, {5, 7, 13, 15, 9, 9, 9, 9, 0, 0, 0, 0});
}

TEST(RoiPooling, HalvesRoundAwayFromZeroAndNanNeverWins) {
  const auto found = run_layer({"ROIPooling",
                                "roi_pooling_param { pooled_h: 1 pooled_w: 1 }",
                                {{Shape{1, 1, 1, 4}, {9, kNan, 2, 3}},
                                 {Shape{3, 5, 1, 1},
                                  {0, 0.5F, 0, 2.4F, 0,  // pixels 1 to 2
                                   0, 1, 0, 1, 0,        //
                                   0, 3, 0, 1, 0}}}});   // inside out: one pixel
  expect_near(found[0].values, {2, -FLT_MAX, 3});
}

TEST(RoiPooling, ARegionOfNoImageShows) {
  const auto found = run_layer(
      {"ROIPooling",
       "roi_pooling_param { pooled_h: 1 pooled_w: 1 }",
       {{Shape{1, 1, 1, 1}, {9}},
        {Shape{4, 5}, {1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 0, kNan, 0, 0, 0, 0, 0, 0, 1e30F, 1e30F}}}});
  expect_near(found[0].values, {kNan, kNan, kNan, 9});
}

TEST(RoiPooling, RejectsInvalidParameters) {
  expect_error<InputError>([] { layer_of("ROIPooling", ""); }, {"pooled_h"});
  expect_rejected("ROIPooling", "roi_pooling_param { pooled_h: 1 pooled_w: 1 }",
                  {Shape{1, 1, 4, 4}, Shape{2, 4}}, {"regions of 5", "2x4"});
}

/// RefineDet: the first stage moves the priors, and drops those with a low second confidence.
TEST(DetectionOutput, OfTwoStages) {
  auto l = detector("confidence_threshold: 0.15 objectness_score: 0.25");
  l.inputs.push_back({Shape{2, 6}, {0, 1, 0, 0.2F, 0, 0.3F, 0, 0, 0, 0.25F, 0, 0}});
  auto wanted = run_layer(l)[0].values;
  expect_near(wanted, {0, 1, 0.9F, 0, 0, 1, 1, 0, 2, 0.6F, 0, 0, 1, 1, 1, 2, 0.7F, 2, 2, 3, 3});
  l.inputs.push_back({Shape{2, 12}, std::vector<float>(24, 0)});
  EXPECT_EQ(run_layer(l)[0].values, wanted);
  std::fill_n(l.inputs[4].values.begin() + 12, 12, 0.5F);  // corners of image 1
  l.inputs[0].values[12 + 4] = 1;                          // xmin of its second prior
  const auto moved = run_layer(l)[0].values;
  expect_near({moved.end() - 7, moved.end()}, {1, 2, 0.7F, 3.5F, 2.5F, 3.5F, 3.5F});
  expect_rejected("DetectionOutput",
                  "detection_output_param { num_classes: 3 objectness_score: 1 }",
                  {Shape{2, 8}, Shape{2, 6}, Shape{1, 2, 8}}, {"RefineDet's 4th input"});
  expect_rejected("DetectionOutput", "detection_output_param { num_classes: 3 }",
                  {Shape{2, 8}, Shape{2, 6}, Shape{1, 2, 8}, Shape{2, 3}},
                  {"2 x 4 confidences", "first stage", "2x3"});
}

/// Two maps of 1 x 2 and 1 x 1 pixels, two boxes for each, two classes. The same numbers in SSD's
/// order, [pixel][box][class] and [pixel][box][4], must give the same rows.
TEST(DetectionOutput, OfSynopsysPermutesItsInputs) {
  const std::vector<int> pixels{2, 1};
  std::string inputs, bottoms;
  std::vector<Tensor> maps(4);
  Tensor locations{Shape{1, 24}, {}}, confidences{Shape{1, 12}, {}}, priors{Shape{1, 2, 24}, {}};
  for (size_t m = 0; m < 2; ++m) {
    const int n = pixels[m];
    maps[m] = {Shape{1, 2, 2, n}, std::vector<float>(4 * n)};
    maps[2 + m] = {Shape{1, 8, 1, n}, std::vector<float>(8 * n)};
    for (int pixel = 0; pixel < n; ++pixel)
      for (int box = 0; box < 2; ++box) {
        for (int c = 0; c < 2; ++c) {
          confidences.values.push_back(0.05F * static_cast<float>(confidences.values.size() + 1));
          maps[m].values[(c * 2 + box) * n + pixel] = confidences.values.back();
        }
        for (int k = 0; k < 4; ++k) {
          locations.values.push_back(0.01F * static_cast<float>(locations.values.size()));
          maps[2 + m].values[(box * 4 + k) * n + pixel] = locations.values.back();
        }
        const float at = 0.2F * static_cast<float>(priors.values.size() / 4);
        priors.values.insert(priors.values.end(), {at, at, at + 0.1F, at + 0.1F});
      }
  }
  for (int i = 0; i < 24; ++i) priors.values.push_back(0.1F);
  const std::string param =
      "num_classes: 2 code_type: CENTER_SIZE nms_param { nms_threshold: 0.4 }";
  const auto wanted = run_layer({"DetectionOutput",
                                 "detection_output_param { " + param + " }",
                                 {locations, confidences, priors}})[0];
  EXPECT_GT(wanted.shape[2], 2);
  std::string text = "layer { name: 'i' type: 'Input' ";
  for (const char* top : {"c1", "c2", "l1", "l2", "p"}) text += str("top: '", top, "' ");
  text += "input_param { ";
  for (const Tensor* t : {&maps[0], &maps[1], &maps[2], &maps[3], &priors})
    text += str("shape { dim: [", joined(t->shape.axes(), ", "), "] } ");
  text += "} }";
  for (const std::string name : {"d", "e", "t"})
    text += str("layer { name: '", name, "' type: 'DetectionOutput' bottom: 'c1' bottom: 'c2' ",
                "bottom: 'l1' bottom: 'l2' bottom: 'p' top: '", name, "' ",
                name == "t" ? "include { phase: TRAIN } " : "", "detection_output_param { ", param,
                " no_permute: true nbottom: 2 } }");
  const TempDir folder;
  write_file(folder / "net.prototxt", text);
  const Net net = Net::load_without_weights(folder / "net.prototxt");
  engine::Run run(net.plan());
  for (const auto& [name, tensor] : {std::pair<std::string, const Tensor&>{"c1", maps[0]},
                                     {"c2", maps[1]},
                                     {"l1", maps[2]},
                                     {"l2", maps[3]},
                                     {"p", priors}})
    std::ranges::copy(tensor.values, run.input(name).data);
  run.forward();
  EXPECT_EQ(net.outputs().size(), 2);
  for (const char* name : {"d", "e"}) {
    const auto found = run.output(name);
    EXPECT_EQ(found.shape, wanted.shape);
    expect_near(std::vector<float>(found.data, found.data + found.shape.elements()), wanted.values);
  }
}

}  // namespace
}  // namespace revisit::engine

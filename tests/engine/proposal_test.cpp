#include "revisit/engine/net.h"
#include "single_layer.h"
#include "testing.h"

namespace revisit::engine {
namespace {

/// A map of 1 x 2 with a stride of 4 and one anchor, (0, 0, 1, 1), on an image of 8 x 8. Without
/// offsets it becomes (0, 0, 2, 2), because its far side is half a width from its center, (1, 1).
test::SingleLayer proposer(const std::string& more = "") {
  return {
      "Proposal",
      "proposal_param { feat_stride: 4 base_size: 2 min_size: 2 ratio: 1 scale: 1 " + more + "}",
      {{Shape{1, 2, 1, 2}, {0.7F, 0.2F, 0.3F, 0.8F}},
       {Shape{1, 4, 1, 2}, std::vector<float>(8, 0)},
       {Shape{1, 3}, {8, 8, 1}}}};
}

test::SingleLayer proposer_of_python() {
  return proposer("} python_param { layer: 'ProposalLayer' ");
}

TEST(Proposal, ByHand) {
  auto l = proposer();
  l.n_outputs = 2;
  const auto found = run_layer(l);
  EXPECT_EQ(found[0].shape, (Shape{2, 5}));
  expect_near(found[0].values, {0, 4, 0, 6, 2, 0, 0, 0, 2, 2});
  EXPECT_EQ(found[1].shape, (Shape{2}));
  expect_near(found[1].values, {0.8F, 0.3F});
}

TEST(Proposal, OffsetsMoveAndScaleAndTheImageCuts) {
  auto l = proposer();
  // First: center (1, 1) by half the width of 2, to (2, 1); 4 high. Second: beyond the right edge.
  l.inputs[1].values = {0.5F, 1, 0, 0, 0, 0, std::log(2.0F), 0};
  expect_near(run_layer(l)[0].values, {0, 6, 0, 7, 2, 0, 1, 0, 3, 3}, 1e-6F);
}

TEST(Proposal, AnchorsOfFasterRcnn) {
  // The table in generate_anchors.py, which counts pixels from 1, at pixel (1, 1) of a coarse map.
  // Far sides are one more (see above).
  test::SingleLayer l{"Proposal",
                      "proposal_param { feat_stride: 1000 ratio: [0.5, 1, 2] scale: [8, 16, 32] "
                      "nms_thresh: 1 }",
                      {{Shape{1, 18, 2, 2}, std::vector<float>(72, 0)},
                       {Shape{1, 36, 2, 2}, std::vector<float>(144, 0)},
                       {Shape{3}, {3000, 3000, 1}}}};
  for (size_t anchor = 0; anchor < 9; ++anchor)
    l.inputs[0].values[(9 + anchor) * 4 + 3] = 1 - 0.1F * static_cast<float>(anchor);
  const std::vector<std::vector<float>> anchors{
      {-83, -39, 100, 56}, {-175, -87, 192, 104},  {-359, -183, 376, 200},
      {-55, -55, 72, 72},  {-119, -119, 136, 136}, {-247, -247, 264, 264},
      {-35, -79, 52, 96},  {-79, -167, 96, 184},   {-167, -343, 184, 360}};
  std::vector<float> wanted;
  for (const auto& a : anchors)
    wanted.insert(wanted.end(), {0, a[0] + 999, a[1] + 999, a[2] + 1000, a[3] + 1000});
  auto found = run_layer(l)[0].values;
  found.resize(wanted.size());
  expect_near(found, wanted);
}

TEST(Proposal, SmallRegionsGetTheScoreZeroOrAreDropped) {
  auto l = proposer();
  l.n_outputs = 2;
  l.inputs[1].values[5] = std::log(0.25F);  // the second becomes half a pixel wide: 0.5 + 1 < 2
  auto found = run_layer(l);
  expect_near(found[0].values, {0, 0, 0, 2, 2, 0, 4.75F, 0, 5.25F, 2});
  expect_near(found[1].values, {0.3F, 0});
  l.param = proposer_of_python().param;
  found = run_layer(l);
  expect_near(found[0].values, {0, 0, 0, 2, 2});
  EXPECT_EQ(found[1].shape, (Shape{1, 1}));
  l.inputs[2].values[2] = 2;  // at this scale of the image both are small
  EXPECT_EQ(run_layer(l)[0].shape.text(), "0x5");
}

TEST(Proposal, ImagesOfTwoScales) {
  auto l = proposer();
  l.n_outputs = 2;
  l.inputs[1].values[5] = std::log(0.25F);          // 3 high, 1.5 wide
  l.inputs[2] = {Shape{1, 4}, {8, 8, 1.5F, 0.5F}};  // at least 3 high, 1 wide
  expect_near(run_layer(l)[1].values, {0.8F, 0.3F});
  l.inputs[2] = {Shape{1, 4}, {8, 8, 0.5F, 1.5F}};
  expect_near(run_layer(l)[1].values, {0.3F, 0});
}

TEST(Proposal, SuppressesOverlappingBoxes) {
  // With scale 2, an anchor (-1, -1, 2, 2) is cut to (0, 0, 3, 3) and shares 9 of 16 pixels with
  // the first. At x = 4 it is (3, 0, 7, 3): 9 of 20.
  auto l = proposer("scale: 2 nms_thresh: 0.5 ");
  l.inputs[0] = {Shape{1, 4, 1, 2}, {0, 0, 0, 0, 0.9F, 0.3F, 0.8F, 0.4F}};
  l.inputs[1] = {Shape{1, 8, 1, 2}, std::vector<float>(16, 0)};
  expect_near(run_layer(l)[0].values, {0, 0, 0, 2, 2, 0, 3, 0, 7, 3, 0, 4, 0, 6, 2});
  l.param = proposer("scale: 2 nms_thresh: 0.6 ").param;
  EXPECT_EQ(run_layer(l)[0].shape, (Shape{4, 5}));
  l.param = proposer("scale: 2 nms_thresh: 0.6 pre_nms_topn: 3 ").param;
  expect_near(run_layer(l)[0].values, {0, 0, 0, 2, 2, 0, 0, 0, 3, 3, 0, 3, 0, 7, 3});
  l.param = proposer("scale: 2 nms_thresh: 0.6 post_nms_topn: 1 ").param;
  expect_near(run_layer(l)[0].values, {0, 0, 0, 2, 2});
}

TEST(Proposal, EqualScoresGoByPlaceAndNanIsLast) {
  auto l = proposer();
  l.inputs[0].values = {0, 0, 0.5F, 0.5F};
  expect_near(run_layer(l)[0].values, {0, 0, 0, 2, 2, 0, 4, 0, 6, 2});
  l.inputs[0].values = {0, 0, kNan, -1};
  expect_near(run_layer(l)[0].values, {0, 4, 0, 6, 2, 0, 0, 0, 2, 2});
}

TEST(Proposal, AnyNumbersGiveRegionsInTheImage) {
  for (const float odd : {kNan, kInf, -kInf, 1e38F})
    for (size_t i = 0; i < 8; ++i) {
      auto l = proposer();
      l.inputs[1].values[i] = odd;
      const auto found = run_layer(l)[0];
      EXPECT_EQ(found.shape[0], 2);
      for (const float v : found.values) EXPECT_TRUE(v >= 0 && v <= 7) << odd << ' ' << i;
    }
  auto l = proposer_of_python();
  l.inputs[1].values[0] = kNan;
  expect_near(run_layer(l)[0].values, {0, 4, 0, 6, 2});
  for (const float odd : {kNan, kInf, -kInf}) {
    l.inputs[2].values = {odd, odd, odd};
    run_layer(l);
  }
}

TEST(Proposal, RejectsInvalidParameters) {
  const auto make = [](const std::string& param) {
    return [=] { layer_of("Proposal", "proposal_param { " + param + " }"); };
  };
  expect_error<InputError>(make(""), {"ratio and scale must be given"});
  expect_error<InputError>(make("ratio: 0 scale: 1"), {"above 0"});
  expect_error<InputError>(make("ratio: 1 scale: inf"), {"finite"});
  expect_error<InputError>(make("ratio: 1 scale: 1 feat_stride: 0"), {"feat_stride"});
  expect_error<InputError>(make("ratio: 1 scale: 1 post_nms_topn: 0"), {"post_nms_topn"});
  expect_error<InputError>(make("ratio: 1 scale: 1 nms_thresh: nan"), {"nms_thresh"});
  const auto infer = [](std::vector<Shape> inputs, size_t n_outputs = 1) {
    return [=] {
      layer_of("Proposal", "proposal_param { ratio: 1 ratio: 2 scale: 1 }")
          ->infer(inputs, n_outputs);
    };
  };
  expect_error<InputError>(infer({Shape{1, 6, 2, 2}, Shape{1, 8, 2, 2}, Shape{1, 3}}),
                           {"1 x 4 x h x w", "2 anchors", "1x6x2x2"});
  expect_error<InputError>(infer({Shape{2, 4, 2, 2}, Shape{2, 8, 2, 2}, Shape{1, 3}}),
                           {"one image", "2x4x2x2"});
  expect_error<InputError>(infer({Shape{1, 4, 2, 2}, Shape{1, 8, 2, 3}, Shape{1, 3}}),
                           {"1x8x2x2", "1x8x2x3"});
  expect_error<InputError>(infer({Shape{1, 4, 2, 2}, Shape{1, 8, 2, 2}, Shape{1, 2}}),
                           {"height, width and scale", "1x2"});
  expect_error<InputError>(infer({Shape{1, 4, 2, 2}, Shape{1, 8, 2, 2}, Shape{1, 3}}, 3),
                           {"1 or 2 outputs"});
}

TEST(PsRoiPooling, ByHand) {
  // 8 channels of 4 x 4 for 2 outputs in 2 x 2 bins: channel c is 100 c + 0..15. The region, both
  // ends included, is the whole image, so that each bin is a quarter, in a channel of its own.
  std::vector<float> image;
  for (int c = 0; c < 8; ++c)
    for (int i = 0; i < 16; ++i) image.push_back(static_cast<float>(100 * c + i));
  test::SingleLayer l{"PSROIPooling",
                      "psroi_pooling_param { spatial_scale: 1 output_dim: 2 group_size: 2 }",
                      {{Shape{1, 8, 4, 4}, image}, {Shape{1, 5}, {0, 0, 0, 3, 3}}}};
  const auto found = run_layer(l);
  EXPECT_EQ(found[0].shape, (Shape{1, 2, 2, 2}));
  expect_near(found[0].values, {2.5F, 104.5F, 210.5F, 312.5F, 402.5F, 504.5F, 610.5F, 712.5F});
  l.threads = 3;
  EXPECT_EQ(run_layer(l)[0].values, found[0].values);
  // Corners are rounded, then scaled: 0.5 and 4.4 are 1 and 4, pixels 0.5 to 2.5 of the map. Bins
  // of one pixel that is not whole take all they touch, here rows and columns 0 to 1 and 1 to 2.
  l.param = "psroi_pooling_param { spatial_scale: 0.5 output_dim: 2 group_size: 2 }";
  l.inputs[1].values = {0, 0.5F, 0.5F, 4.4F, 4.4F};
  expect_near(run_layer(l)[0].values,
              {2.5F, 103.5F, 206.5F, 307.5F, 402.5F, 503.5F, 606.5F, 707.5F});
  // A region of one pixel with a quarter of its size more at each end is -0.25 to 0.25, rounded 0
  // to 0; with 1.5 it is -1.5 to 1.5, rounded -2 to 2, of which the image has 0 to 2.
  l.inputs[1].values = {0, 0, 0, 0, 0};
  for (const auto& [ratio, mean] : {std::pair{0.25F, 0.0F}, {1.5F, 5.0F}}) {
    l.param =
        str("psroi_pooling_param { spatial_scale: 1 output_dim: 8 group_size: 1 pad_ratio: ", ratio,
            " }");
    EXPECT_FLOAT_EQ(run_layer(l)[0].values[0], mean);
  }
  // PPR-FCN: bins beside the first object, pixels 1 to 2 of the last row, are 0.
  const std::string sizes = "{ spatial_scale: 1 output_dim: 2 group_size: 2 }";
  l.type = "PSROIContextPooling";
  l.param = "psroi_context_pooling_param " + sizes;
  l.inputs[1].values = {0, 0, 0, 3, 3};
  l.inputs.push_back({Shape{2, 5}, {0, 1, 3, 2, 3, 0, 0, 0, 3, 3}});
  expect_near(run_layer(l)[0].values, {0, 0, 210.5F, 312.5F, 0, 0, 610.5F, 712.5F});
  expect_rejected(l.type, l.param, {Shape{1, 8, 4, 4}, Shape{1, 5}}, {"the objects"});
  expect_rejected(l.type, l.param, {Shape{1, 8, 4, 4}, Shape{1, 5}, Shape{1, 4}}, {"5 numbers"});
}

TEST(PsRoiPooling, EmptyBinsAreZeroAndRegionsOfNoImageShow) {
  test::SingleLayer l{
      "PSROIPooling",
      "psroi_pooling_param { spatial_scale: 1 output_dim: 1 group_size: 1 }",
      {{Shape{2, 1, 1, 2}, {1, 2, 3, 4}},
       {Shape{8, 5}, {1,  0,      0,      1,     0,  //
                      0,  5,      0,      9,     0,  // beside the image
                      0,  1,      0,      -3,    0,  // inside out: a tenth of a pixel
                      2,  0,      0,      1,     0,  //
                      -1, 0,      0,      1,     0,  //
                      0,  kNan,   0,      1,     0,  //
                      0,  kInf,   0,      1,     0,  //
                      0,  -1e30F, -1e30F, 1e30F, 1e30F}}}};
  expect_near(run_layer(l)[0].values, {3.5F, 0, 2, kNan, kNan, kNan, kNan, 1.5F});
}

TEST(PsRoiPooling, RejectsInvalidParameters) {
  const auto make = [](const std::string& param) {
    return [=] { layer_of("PSROIPooling", "psroi_pooling_param { " + param + " }"); };
  };
  expect_error<InputError>(make("output_dim: 1 group_size: 1"), {"must be given"});
  expect_error<InputError>(make("spatial_scale: 1 output_dim: 0 group_size: 1"), {"at least 1"});
  expect_error<InputError>(make("spatial_scale: nan output_dim: 1 group_size: 1"), {"finite"});
  expect_error<InputError>(make("spatial_scale: 1 output_dim: 1 group_size: 2147483647"),
                           {"square of group_size"});
  expect_rejected("PSROIPooling",
                  "psroi_pooling_param { spatial_scale: 1 output_dim: 3 group_size: 2 }",
                  {Shape{1, 8, 4, 4}, Shape{2, 5}}, {"12 channels", "1x8x4x4"});
}

TEST(RoiPooling, EveryChannelAndRegionIsPooled) {
  // More channels than one thread takes at a time: channel c of image n is 100 n + c.
  Tensor images{Shape{2, 70, 2, 2}, {}};
  std::vector<float> wanted;
  for (int n = 0; n < 2; ++n)
    for (int c = 0; c < 70; ++c)
      images.values.insert(images.values.end(), 4, static_cast<float>(100 * n + c));
  for (const int n : {1, 0, 1})
    for (int c = 0; c < 70; ++c) wanted.push_back(static_cast<float>(100 * n + c));
  const Tensor regions{Shape{3, 5}, {1, 0, 0, 1, 1, 0, 0, 0, 1, 1, 1, 0, 0, 1, 1}};
  for (const int threads : {1, 3}) {
    test::SingleLayer l{
        "ROIPooling", "roi_pooling_param { pooled_h: 1 pooled_w: 1 }", {images, regions}};
    l.threads = threads;
    expect_near(run_layer(l)[0].values, wanted);
    l.type = "PSROIPooling";
    l.param = "psroi_pooling_param { spatial_scale: 1 output_dim: 70 group_size: 1 }";
    expect_near(run_layer(l)[0].values, wanted);
  }
}

TEST(RoiPooling, PadRatioEnlargesRegions) {
  // Pixels 2 to 3 of 0..7, 2 wide: with half of that at each end, 1 to 4; one beyond all numbers is
  // cut.
  test::SingleLayer l{"ROIPooling",
                      "roi_pooling_param { pooled_h: 1 pooled_w: 2 pad_ratio: 0.5 }",
                      {{Shape{1, 1, 1, 8}, {0, 1, 2, 3, 4, 5, 6, 7}},
                       {Shape{2, 5}, {0, 2, 0, 3, 0, 0, -3e38F, 0, 3e38F, 0}}}};
  expect_near(run_layer(l)[0].values, {2, 4, 0, 7});
  expect_rejected("ROIPooling", "roi_pooling_param { pooled_h: 1 pooled_w: 1 pad_ratio: nan }", {},
                  {"pad_ratio"});
}

/// A small Faster R-CNN; `proposal` has the fields of its layer besides the bottoms.
std::string detector(const std::string& proposal, const std::string& pooling) {
  return R"(
    layer { name: "in" type: "Input" top: "data" top: "info"
            input_param { shape { dim: 1 dim: 3 dim: 24 dim: 32 } shape { dim: 1 dim: 3 } } }
    layer { name: "conv" type: "Convolution" bottom: "data" top: "conv"
            convolution_param { num_output: 12 kernel_size: 4 stride: 4 } }
    layer { name: "relu" type: "ReLU" bottom: "conv" top: "conv" }
    layer { name: "score" type: "Convolution" bottom: "conv" top: "score"
            convolution_param { num_output: 4 kernel_size: 1 } }
    layer { name: "apart" type: "Reshape" bottom: "score" top: "apart"
            reshape_param { shape { dim: 0 dim: 2 dim: -1 dim: 0 } } }
    layer { name: "sure" type: "Softmax" bottom: "apart" top: "sure" }
    layer { name: "together" type: "Reshape" bottom: "sure" top: "together"
            reshape_param { shape { dim: 0 dim: 4 dim: -1 dim: 0 } } }
    layer { name: "offset" type: "Convolution" bottom: "conv" top: "offset"
            convolution_param { num_output: 8 kernel_size: 1 } }
    layer { name: "rois" bottom: "together" bottom: "offset" bottom: "info" top: "rois" )" +
         proposal + " } " + pooling;
}

const std::string kProposal =
    "type: 'Proposal' proposal_param { feat_stride: 4 base_size: 8 min_size: 4 ratio: 1 scale: 1 "
    "scale: 2 post_nms_topn: 90 nms_thresh: 0.5 } ";

const std::string kHead = R"(
    layer { name: "pool" type: "ROIPooling" bottom: "conv" bottom: "rois" top: "pool"
            roi_pooling_param { pooled_h: 3 pooled_w: 3 spatial_scale: 0.25 } }
    layer { name: "more" type: "Convolution" bottom: "pool" top: "more"
            convolution_param { num_output: 16 kernel_size: 3 pad: 1 } }
    layer { name: "bn" type: "BatchNorm" bottom: "more" top: "more" }
    layer { name: "scale" type: "Scale" bottom: "more" top: "more" }
    layer { name: "add" type: "Eltwise" bottom: "more" bottom: "more" top: "sum" }
    layer { name: "mean" type: "Pooling" bottom: "sum" top: "mean"
            pooling_param { pool: AVE global_pooling: true } }
    layer { name: "fc" type: "InnerProduct" bottom: "pool" top: "fc"
            inner_product_param { num_output: 24 } }
    layer { name: "drop" type: "Dropout" bottom: "fc" top: "fc" }
    layer { name: "class" type: "InnerProduct" bottom: "fc" top: "class"
            inner_product_param { num_output: 5 } }
    layer { name: "prob" type: "Softmax" bottom: "class" top: "prob" }
    layer { name: "parts" type: "PSROIPooling" bottom: "conv" bottom: "rois" top: "parts"
            psroi_pooling_param { spatial_scale: 0.25 output_dim: 3 group_size: 2 } })";

class RegionNet : public testing::Test {
 protected:
  Net load(const std::string& text) {
    write_file(dir_ / "net.prototxt", text);
    return Net::load_with_random_weights(dir_ / "net.prototxt", 7);
  }
  static void forward(engine::Run& run, float scale) {
    const std::vector<float> image = test::random_floats(3 * 24 * 32, 5);
    std::copy(image.begin(), image.end(), run.input("data").data);
    const float info[] = {24, 32, scale};
    std::copy_n(info, 3, run.input("info").data);
    run.forward();
  }
  const TempDir dir_;
};

TEST_F(RegionNet, TheHeadComputesEachRow) {
  engine::Run run(load(detector(kProposal, kHead)).plan({}, {.keep = {"rois", "conv"}}));
  forward(run, 1);
  const auto rois = run.layer_output("rois");
  const int64_t n = rois.shape[0];
  ASSERT_GT(n, 3);
  ASSERT_LT(n, 90);
  EXPECT_EQ(run.output("prob").shape, (Shape{n, 5}));
  EXPECT_EQ(run.output("mean").shape, (Shape{n, 16, 1, 1}));
  EXPECT_EQ(run.output("parts").shape, (Shape{n, 3, 2, 2}));

  // The head alone yields the same results for these regions.
  const std::string given =
      str("layer { name: 'given' type: 'Input' top: 'rois' input_param { shape { dim: ", n,
          " dim: 5 } } }");
  std::string body = detector("", "");
  body.resize(body.find("layer { name: \"rois\""));
  engine::Run head(load(body + given + kHead).plan());
  std::copy_n(rois.data, n * 5, head.input("rois").data);
  forward(head, 1);
  for (const std::string output : {"prob", "mean", "parts"}) {
    const auto found = run.output(output).values(), wanted = head.output(output).values();
    expect_near({found.begin(), found.end()}, {wanted.begin(), wanted.end()}, 1e-6F);
  }
}

TEST_F(RegionNet, NoRegionGivesNoRows) {
  engine::Run run(load(detector(kProposal + "python_param { }", kHead)).plan());
  forward(run, 100);  // all are small then
  EXPECT_EQ(run.output("prob").shape.text(), "0x5");
  EXPECT_EQ(run.output("parts").shape.text(), "0x3x2x2");
  forward(run, 1);
  EXPECT_GT(run.output("prob").shape[0], 3);
}

TEST_F(RegionNet, RowsMayFoldIntoOtherAxesAndBack) {
  const std::string fold = R"(
    layer { name: "fold" type: "Reshape" bottom: "pool" top: "fold"
            reshape_param { shape { dim: -1 dim: 9 } } }
    layer { name: "soft" type: "Softmax" bottom: "fold" top: "soft" }
    layer { name: "back" type: "Reshape" bottom: "soft" top: "back"
            reshape_param { shape { dim: -1 dim: 12 dim: 9 } } })";
  engine::Run run(load(detector(kProposal, kHead + fold)).plan());
  forward(run, 1);
  EXPECT_EQ(run.output("back").shape, (Shape{run.output("prob").shape[0], 12, 9}));
}

/// As the Proposal of Python, with the anchor (0, 0, 1, 1) given.
TEST(FrcnnProposal, HasGivenAnchors) {
  auto l = proposer_of_python();
  const auto wanted = run_layer(l)[0].values;
  l.type = "FrcnnProposal";
  l.param = "proposal_param { feat_stride: 4 min_size: 2 anchor: [0, 0, 1, 1] }";
  EXPECT_EQ(run_layer(l)[0].values, wanted);
  const std::vector<Shape> inputs{Shape{1, 2, 1, 2}, Shape{1, 4, 1, 2}, Shape{1, 3}};
  expect_rejected("FrcnnProposal", "", inputs, {"in the JSON file", "anchor: -84"});
  for (const auto& [param, part] : {std::pair{"anchor: [0, 0, 1]", "4 numbers for each"},
                                    {"anchor: [0, 0, 1, 1] ratio: 1", "not both"}})
    expect_rejected("FrcnnProposal", str("proposal_param { ", param, " }"), inputs, {part});
}

}  // namespace
}  // namespace revisit::engine

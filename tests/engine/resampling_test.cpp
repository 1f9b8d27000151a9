#include "single_layer.h"
#include "testing.h"

namespace revisit::engine {
namespace {

TEST(Pooling, CeilModeIsTheForksRoundMode) {
  const auto pool = [](const std::string& mode) {
    return run_layer(
               {"Pooling",
                "pooling_param { kernel_h: 1 kernel_w: 3 stride_h: 1 stride_w: 2 " + mode + " }",
                {{Shape{1, 1, 1, 4}, {1, 5, 2, 4}}}})[0]
        .values;
  };
  expect_near(pool("ceil_mode: false"), {5});
  expect_near(pool("ceil_mode: true"), {5, 4});
  expect_error<InputError>([&] { pool("ceil_mode: true round_mode: CEIL"); },
                           {"round_mode or ceil_mode"});
}

TEST(Spp, LevelsSideBySide) {
  // Two channels of 2x2: the whole, then each pixel.
  const Tensor input{Shape{2, 2, 2, 2}, {1, 2, 3, 4, 8, 7, 6, 5, 0, 0, 0, 9, -1, -2, -3, -4}};
  const auto found = run_layer({"SPP", "spp_param { pyramid_height: 2 }", {input}});
  EXPECT_EQ(found[0].shape, (Shape{2, 10}));
  expect_near(found[0].values, {4, 8, 1, 2, 3, 4, 8, 7, 6, 5, 9, -1, 0, 0, 0, 9, -1, -2, -3, -4});
}

TEST(Spp, OneLevelIsAPoolingLayer) {
  const auto found = run_layer(
      {"SPP", "spp_param { pyramid_height: 1 pool: AVE }", {{Shape{1, 1, 2, 2}, {1, 2, 3, 6}}}});
  EXPECT_EQ(found[0].shape, (Shape{1, 1, 1, 1}));
  expect_near(found[0].values, {3});
}

TEST(Spp, UnevenBinsArePaddedAtBothEnds) {
  // 3 pixels in 2 bins: kernel 2, pad (1 + 1) / 2 = 1: windows {0} and {1, 2}. Padding counts in
  // the average: 2 / 2 and (4 + 6) / 2.
  const auto found = run_layer({"SPP",
                                "spp_param { pyramid_height: 2 pool: AVE }",
                                {{Shape{1, 1, 2, 3}, {2, 4, 6, 2, 4, 6}}}});
  EXPECT_EQ(found[0].shape, (Shape{1, 5}));
  expect_near(found[0].values, {4, 1, 5, 1, 5});
}

TEST(Spp, RefusesTooFineAPyramid) {
  expect_rejected("SPP", "spp_param { pyramid_height: 4000000000 }", {Shape{1, 1, 8, 8}},
                  {"level 4", "16 x 16", "8 x 8"});
  expect_error<InputError>([] { layer_of("SPP", ""); }, {"pyramid_height"});
}

TEST(Interp, CornersStayCorners) {
  const Tensor image{Shape{1, 1, 2, 2}, {0, 4, 8, 12}};
  const auto found = run_layer({"Interp", "interp_param { height: 3 width: 5 }", {image}});
  expect_near(found[0].values, {0, 1, 2, 3, 4, 4, 5, 6, 7, 8, 8, 9, 10, 11, 12});
  // One row or column of output is the first of the input.
  expect_near(run_layer({"Interp", "interp_param { height: 1 width: 2 }", {image}})[0].values,
              {0, 4});
}

TEST(Interp, FactorsAndCropping) {
  const auto shape = [](const std::string& param) {
    return layer_of("Interp", "interp_param { " + param + " }")->infer({Shape{1, 1, 9, 13}}, 1)[0];
  };
  EXPECT_EQ(shape("zoom_factor: 8"), (Shape{1, 1, 65, 97}));
  EXPECT_EQ(shape("shrink_factor: 2"), (Shape{1, 1, 5, 7}));
  EXPECT_EQ(shape("shrink_factor: 2 zoom_factor: 3"), (Shape{1, 1, 13, 19}));
  EXPECT_EQ(shape("zoom_factor: 2 height: 5 width: 5"), (Shape{1, 1, 17, 25}));
  EXPECT_EQ(shape("shrink_factor: 2 zoom_factor: 3 height: 5 width: 6"), (Shape{1, 1, 5, 6}));
  EXPECT_EQ(shape("zoom_factor: 1 pad_beg: -1 pad_end: -2"), (Shape{1, 1, 6, 10}));
  // Cropped only: a copy, so NaN and infinity stay in place.
  const auto found = run_layer({"Interp",
                                "interp_param { zoom_factor: 1 pad_beg: -1 }",
                                {{Shape{1, 1, 3, 3}, {1, 2, 3, 4, kNan, 6, 7, 8, kInf}}}});
  expect_near(found[0].values, {kNan, 6, 8, kInf});
}

TEST(Interp, RejectsInvalidParameters) {
  const auto infer = [](const std::string& param) {
    return [=] {
      layer_of("Interp", "interp_param { " + param + " }")->infer({Shape{1, 1, 3, 3}}, 1);
    };
  };
  expect_error<InputError>(infer("height: 3"), {"height and width"});
  expect_error<InputError>(infer("height: -3 width: 3"), {"at least 1"});
  expect_error<InputError>(infer("zoom_factor: 0"), {"zoom_factor"});
  expect_error<InputError>(infer("zoom_factor: 2 pad_beg: 1"), {"only crop"});
  expect_error<InputError>(infer("zoom_factor: 2 pad_beg: -2147483648"), {"leaves nothing"});
  expect_error<InputError>(infer("zoom_factor: 2000000000"), {"more than"});
  expect_error<UnsupportedError>(infer("zoom_factor: 2 interp_type: 'nearest_neighbor'"),
                                 {"nearest_neighbor"});
}

TEST(Upsample, PutsValuesWhereTheMaskSays) {
  const auto found =
      run_layer({"Upsample",
                 "upsample_param { scale: 2 pad_out_w: true }",
                 {{Shape{1, 2, 1, 2}, {5, 6, 7, 8}}, {Shape{1, 2, 1, 2}, {1, 5, 0, 0}}}});
  EXPECT_EQ(found[0].shape, (Shape{1, 2, 2, 3}));
  expect_near(found[0].values, {0, 5, 0, 0, 0, 6, 8, 0, 0, 0, 0, 0});
}

/// DeconvNet's layer, of which an image takes the first channels.
TEST(Upsample, AMaskMayHaveMoreChannels) {
  const std::string param = "unpooling_param { unpool_h: 2 unpool_w: 2 }";
  const Tensor mask{Shape{1, 2, 1, 1}, {3, 0}};
  const auto file = proto::parse_net(
      "layer { name: 'u' type: 'Unpooling' bottom: 'a' bottom: 'm' " + param + " }", "net");
  EXPECT_EQ(file.net.layer(0).type(), "Upsample");
  const std::string upsample = "upsample_param { upsample_h: 2 upsample_w: 2 }";
  expect_near(run_layer({"Upsample", upsample, {{Shape{1, 1, 1, 1}, {5}}, mask}})[0].values,
              {0, 0, 0, 5});
  expect_rejected("Upsample", upsample, {Shape{2, 1, 1, 1}, Shape{2, 2, 1, 1}}, {"the mask"});
  expect_rejected("Upsample", upsample, {Shape{1, 3, 1, 1}, Shape{1, 2, 1, 1}}, {"the mask"});
}

TEST(Upsample, UndoesAPoolingOfAnySize) {
  const Tensor image{Shape{1, 1, 3, 3}, {1, 9, 2, 3, 4, 5, 8, 6, 7}};
  const auto pooled = run_layer({.type = "Pooling",
                                 .param = "pooling_param { kernel_size: 2 stride: 2 }",
                                 .inputs = {image},
                                 .n_outputs = 2});
  const auto found = run_layer(
      {"Upsample", "upsample_param { upsample_h: 3 upsample_w: 3 }", {pooled[0], pooled[1]}});
  expect_near(found[0].values, {0, 9, 0, 0, 0, 5, 8, 0, 7});
}

TEST(Upsample, AMaskOfAnotherImageShows) {
  const auto found =
      run_layer({"Upsample",
                 "upsample_param { upsample_h: 2 upsample_w: 2 }",
                 {{Shape{1, 4, 1, 1}, {5, 6, 7, 8}}, {Shape{1, 4, 1, 1}, {4, -1, 3, kNan}}}});
  expect_near(found[0].values,
              {kNan, kNan, kNan, kNan, kNan, kNan, kNan, kNan, 0, 0, 0, 7, kNan, kNan, kNan, kNan});
}

TEST(Upsample, WithoutAMaskItRepeatsPixels) {
  const auto found =
      run_layer({"Upsample", "upsample_param { scale: 2 }", {{Shape{1, 1, 1, 2}, {5, 6}}}});
  EXPECT_EQ(found[0].shape, (Shape{1, 1, 2, 4}));
  expect_near(found[0].values, {5, 5, 6, 6, 5, 5, 6, 6});
}

TEST(Upsample, RejectsInvalidParameters) {
  const Shape image{1, 1, 2, 2};
  const auto infer = [&](const std::string& param, std::vector<Shape> inputs) {
    return [=] { layer_of("Upsample", "upsample_param { " + param + " }")->infer(inputs, 1); };
  };
  expect_error<InputError>(infer("", {image}), {"give scale"});
  expect_error<InputError>(infer("scale: 0", {image}), {"at least 1"});
  expect_error<InputError>(infer("scale_h: 2 scale_w: 2", {image}), {"give scale"});
  expect_error<InputError>(infer("scale: 1", {image, image}), {"at least 2"});
  expect_error<InputError>(infer("scale_h: 2", {image, image}), {"scale_h and scale_w"});
  expect_error<InputError>(infer("scale: 3 pad_out_h: true", {image, image}), {"scale of 2"});
  expect_error<InputError>(infer("", {image, Shape{1, 1, 4, 4}}), {"mask", "1x1x2x2", "1x1x4x4"});
}

}  // namespace
}  // namespace revisit::engine

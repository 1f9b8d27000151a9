#include "checked_layer.h"
#include "simd_targets.h"
#include "testing.h"

namespace revisit::engine {
namespace {

Tensor count_up(const Shape& shape) {
  std::vector<float> values(static_cast<size_t>(shape.elements()));
  std::iota(values.begin(), values.end(), 0.0F);
  return {shape, values};
}

Shape reshaped(const std::string& param, const Shape& input) {
  return layer_of("Reshape", "reshape_param { " + param + " }")->infer({input}, 1)[0];
}

TEST(Reshape, CopiesInfersAndInserts) {
  const Shape input{2, 3, 5, 4};
  EXPECT_EQ(reshaped("shape { dim: 0 dim: -1 dim: 4 }", input), (Shape{2, 15, 4}));
  EXPECT_EQ(reshaped("shape { dim: -1 }", input), Shape{120});
  EXPECT_EQ(reshaped("shape { dim: 5 dim: 3 } axis: 1 num_axes: 2", input), (Shape{2, 5, 3, 4}));
  EXPECT_EQ(reshaped("shape { dim: 2 dim: -1 } axis: -2", input), (Shape{2, 3, 5, 2, 2}));
  EXPECT_EQ(reshaped("shape { dim: 1 } axis: -1 num_axes: 0", input), (Shape{2, 3, 5, 4, 1}));
  EXPECT_EQ(reshaped("shape { dim: 1 dim: 1 } num_axes: 0", input), (Shape{1, 1, 2, 3, 5, 4}));
  EXPECT_EQ(reshaped("shape { dim: 0 dim: 0 dim: 20 }", input), (Shape{2, 3, 20}));
  EXPECT_EQ(reshaped("", Shape{1, 1}), Shape{});
}

TEST(Squeeze, RemovesAxesOfSizeOne) {
  const auto squeezed = [](const std::string& axes) {
    return layer_of("Squeeze", "squeeze_param { " + axes + " }")->infer({Shape{1, 3, 1, 4}}, 1)[0];
  };
  EXPECT_EQ(squeezed(""), (Shape{3, 4}));
  EXPECT_EQ(squeezed("axis: 2"), (Shape{1, 3, 4}));
  EXPECT_EQ(squeezed("axis: -2 axis: 0"), (Shape{3, 4}));
  expect_error<InputError>([&] { squeezed("axis: 1"); }, {"axis 1", "1x3x1x4", "size 1"});
  expect_error<InputError>([&] { squeezed("axis: 4"); }, {"squeeze axis"});
}

TEST(Reshape, RejectsUnequalElementCounts) {
  const Shape input{2, 3, 4};
  const auto refused = [&](const std::string& param, const std::string& reason) {
    expect_error<InputError>([&] { reshaped(param, input); }, {reason});
  };
  refused("shape { dim: -1 dim: -1 }", "at most one dim");
  refused("shape { dim: -2 }", "found -2");
  refused("shape { dim: 5 dim: 7 }", "24 values");
  refused("shape { dim: 5 dim: -1 }", "24 values");
  refused("shape { dim: 2 dim: 3 dim: 4 dim: 0 }", "no such axis");
  refused("shape { dim: 1 } axis: 4", "axis 4");
  refused("shape { dim: 1 } axis: -5", "axis -5");
  refused("shape { dim: 1 } axis: 1 num_axes: 3", "reach past");
  refused("shape { dim: 24 } num_axes: -2", "num_axes");
  refused("shape { dim: 4294967296 dim: 4294967296 dim: -1 }", "more than");
  EXPECT_FALSE(layer_of("Reshape", "")->allows_in_place());
}

TEST(Slice, AtPointsOrEqually) {
  const Tensor x = count_up({2, 3});
  const auto parts = run_checked("Slice", "slice_param { slice_point: 1 }", {x}, {}, 2);
  EXPECT_EQ(parts[0].shape, (Shape{2, 1}));
  EXPECT_EQ(parts[1].shape, (Shape{2, 2}));
  expect_near(parts[0].values, {0, 3});
  expect_near(parts[1].values, {1, 2, 4, 5});
  const auto rows = run_checked("Slice", "slice_param { slice_dim: 0 }", {x}, {}, 2);
  expect_near(rows[1].values, {3, 4, 5});
  const auto columns = run_checked("Slice", "slice_param { axis: -1 }", {x}, {}, 3);
  expect_near(columns[2].values, {2, 5});
  expect_near(run_checked("Slice", "", {x})[0].values, x.values);
}

TEST(Slice, RefusesPointsOutOfOrder) {
  const auto infer = [](const std::string& param, size_t outputs) {
    layer_of("Slice", "slice_param { " + param + " }")->infer({Shape{1, 4}}, outputs);
  };
  expect_error<InputError>([&] { infer("", 3); }, {"3 equal parts", "1x4"});
  expect_error<InputError>([&] { infer("slice_point: 1", 3); }, {"2 slice points", "found 1"});
  for (const std::string points : {"slice_point: 0", "slice_point: 4", "slice_point: 5"})
    expect_error<InputError>([&] { infer(points, 2); }, {"above 0 to below 4"});
  expect_error<InputError>([&] { infer("slice_point: 2 slice_point: 2", 3); }, {"increase"});
  expect_error<InputError>([&] { infer("axis: 1 slice_dim: 1", 2); }, {"not both"});
  expect_error<InputError>([&] { infer("slice_dim: 2", 2); }, {"axis 2"});
  expect_error<InputError>([&] { infer("slice_dim: 4294967295", 2); }, {"out of range"});
  expect_error<InputError>([&] { infer("", 0); }, {"at least one output"});
}

/// PPR-FCN: as many times as the second input has items, whatever `tiles` says.
TEST(Tile, ForEachItemOfASecondInput) {
  for (const std::string tiles : {"", "tiles: 1"}) {
    const auto found = run_checked("Tile", "tile_param { " + tiles + " }",
                                   {count_up({1, 2}), count_up({3, 7})})[0];
    EXPECT_EQ(found.shape, (Shape{1, 6}));
    expect_near(found.values, {0, 1, 0, 1, 0, 1});
  }
}

TEST(Tile, RepeatsAlongAnAxis) {
  Shape shape;
  expect_near(run("Tile", "tile_param { tiles: 2 }", {2, 2}, {1, 2, 3, 4}, {}, &shape),
              {1, 2, 1, 2, 3, 4, 3, 4});
  EXPECT_EQ(shape, (Shape{2, 4}));
  expect_near(run("Tile", "tile_param { axis: 0 tiles: 2 }", {1, 2}, {1, 2}), {1, 2, 1, 2});
  for (const std::string tiles : {"", "tiles: 0", "tiles: -1"})
    expect_rejected("Tile", "tile_param { " + tiles + " }", {Shape{2, 2}}, {"tiles"});
  expect_rejected("Tile", "tile_param { tiles: 2147483647 }", {Shape{2, 2}}, {"more than"});
}

TEST(Crop, ToTheSizeOfTheSecondInput) {
  const Tensor x = count_up({1, 1, 3, 4});
  const Tensor size = count_up({1, 9, 2, 2});
  const auto crop = [&](const std::string& param) {
    return run_checked("Crop", "crop_param { " + param + " }", {x, size})[0];
  };
  EXPECT_EQ(crop("").shape, (Shape{1, 1, 2, 2}));
  expect_near(crop("").values, {0, 1, 4, 5});
  expect_near(crop("offset: 1").values, {5, 6, 9, 10});
  expect_near(crop("offset: 1 offset: 2").values, {6, 7, 10, 11});
  expect_near(crop("axis: -1 offset: 2").values, {2, 3, 6, 7, 10, 11});
  expect_error<InputError>([&] { crop("offset: 2"); }, {"axis 2", "from 2"});
  expect_error<InputError>([&] { crop("axis: 1"); }, {"axis 1", "9 values"});
  expect_error<InputError>([&] { crop("offset: 1 offset: 1 offset: 1"); }, {"2 axes", "found 3"});
  expect_error<InputError>([&] { crop("offset: 4294967295"); }, {"reach past"});
  expect_error<InputError>([&] { crop("axis: 4"); }, {"axis 4"});
  expect_rejected("Crop", "", {x.shape, Shape{2, 2}}, {"fewer axes"});
}

TEST(CropCenter, CutsBothEndsOfEachAxis) {
  Shape shape;
  expect_near(run("CropCenter", "crop_center_param { crop_size: 0 crop_size: 1 crop_size: 2 }",
                  {1, 3, 6}, count_up({1, 3, 6}).values, {}, &shape),
              {8, 9});
  EXPECT_EQ(shape, (Shape{1, 1, 2}));
  const auto infer = [](const std::string& sizes) {
    layer_of("CropCenter", "crop_center_param { " + sizes + " }")->infer({Shape{4, 5}}, 1);
  };
  expect_error<InputError>([&] { infer("crop_size: 1"); }, {"2 axes", "4x5", "found 1"});
  expect_error<InputError>([&] { infer("crop_size: 2 crop_size: 0"); },
                           {"axis 0", "leaves nothing"});
  expect_error<InputError>([&] { infer("crop_size: 0 crop_size: 4294967295"); }, {"crop_size"});
}

TEST(BatchReindex, ChoosesImagesAndMarksBadIndices) {
  const auto reindex = [](const std::vector<float>& indices) {
    return run_checked(
        "BatchReindex", "",
        {count_up({2, 2}), {Shape{static_cast<int64_t>(indices.size())}, indices}})[0];
  };
  EXPECT_EQ(reindex({1, 0, 1}).shape, (Shape{3, 2}));
  expect_near(reindex({1, 0, 1.5F}).values, {2, 3, 0, 1, 2, 3});
  expect_near(reindex({2, -0.5F, kNan, 1e30F}).values, std::vector<float>(8, kNan));
  const auto layer = layer_of("BatchReindex", "");
  expect_error<InputError>([&] { layer->infer({Shape{2, 2}, Shape{1, 2}}, 1); }, {"one axis"});
  expect_error<InputError>([&] { layer->infer({Shape{}, Shape{2}}, 1); }, {"one axis"});
}

TEST(Embed, LooksRowsUpAndMarksBadIndices) {
  const std::string param = "embed_param { input_dim: 3 num_output: 2 bias_term: false }";
  Shape shape;
  expect_near(run("Embed", param, {1, 2}, {2, 0}, {{1, 2, 3, 4, 5, 6}}, &shape), {5, 6, 1, 2});
  EXPECT_EQ(shape, (Shape{1, 2, 2}));
  expect_near(run("Embed", param, {6}, {2.5F, -0.5F, 3, -1, kNan, -1e30F}, {{1, 2, 3, 4, 5, 6}}),
              {5, 6, 1, 2, kNan, kNan, kNan, kNan, kNan, kNan, kNan, kNan});
  expect_near(
      run("Embed", "embed_param { input_dim: 1 num_output: 2 }", {1}, {0}, {{1, 2}, {10, 20}}),
      {11, 22});
  expect_rejected("Embed", "embed_param { input_dim: 3 }", {}, {"num_output"});
  expect_rejected("Embed", "embed_param { num_output: 3 }", {}, {"input_dim"});
}

TEST(Permute, TransposesAndCompletesTheOrder) {
  const Tensor x = count_up({2, 3});
  Shape shape;
  expect_near(run("Permute", "permute_param { order: 1 }", x.shape, x.values, {}, &shape),
              {0, 3, 1, 4, 2, 5});
  EXPECT_EQ(shape, (Shape{3, 2}));
  const auto twice = [&](const Tensor& t) {  // n c h w -> n h w c and back
    const auto last =
        run_checked("Permute", "permute_param { order: 0 order: 2 order: 3 order: 1 }", {t})[0];
    EXPECT_EQ(last.shape, (Shape{2, 40, 50, 3}));
    EXPECT_EQ(last.values[1], t.values[2000]);
    return run_checked("Permute", "permute_param { order: 0 order: 3 }", {last})[0];
  };
  const Tensor images = count_up({2, 3, 40, 50});
  EXPECT_EQ(twice(images).values, images.values);
  expect_near(run("Permute", "", {}, {7}), {7});
  expect_rejected("Permute", "permute_param { order: 1 order: 1 }", {}, {"axis 1 twice"});
  expect_rejected("Permute", "permute_param { order: 2 }", {Shape{2, 3}}, {"axis 2", "2x3"});
}

TEST(Transpose, NamesEachAxis) {
  Shape shape;
  expect_near(run("Transpose", "transpose_param { dim: 2 dim: 0 dim: 1 }", {1, 2, 3},
                  {0, 1, 2, 3, 4, 5}, {}, &shape),
              {0, 3, 1, 4, 2, 5});  // axis 0 of the output is axis 2 of the input
  EXPECT_EQ(shape, (Shape{3, 1, 2}));
  const Tensor x = count_up({2, 3, 5, 7});
  EXPECT_EQ(
      run_checked("Transpose", "transpose_param { dim: 3 dim: 1 dim: 0 dim: 2 }", {x})[0].values,
      run_checked("Permute", "permute_param { order: 3 order: 1 order: 0 }", {x})[0].values);
  const auto refused = [](const std::string& dims, const Shape& input,
                          std::initializer_list<std::string> reasons) {
    expect_rejected("Transpose", "transpose_param { " + dims + " }", {input}, reasons);
  };
  refused("dim: 1 dim: 1", {2, 3}, {"dim names axis 1 twice"});
  refused("dim: 1", {2, 3}, {"each of the 2 axes", "2x3", "found 1"});
  refused("dim: 1 dim: 0", {2}, {"each of the 1 axes", "found 2"});
  refused("dim: 2 dim: 0", {2, 3}, {"axis 2", "2x3"});
  refused("dim: -1 dim: 0", {2, 3}, {"axis -1"});
  refused("", {}, {"each of the 0 axes"});
}

/// Sizes that are not multiples of the squares, and large enough for several threads.
TEST(Transpose, OfAnyOrder) {
  const Tensor x = count_up({3, 41, 18, 35});
  std::vector<size_t> order{0, 1, 2, 3};
  do {
    SCOPED_TRACE(testing::PrintToString(order));
    std::string dims;
    for (const size_t axis : order) dims += str(" dim: ", axis);
    std::vector<float> wanted;
    const std::vector<int64_t> strides{41 * 18 * 35, 18 * 35, 35, 1};
    const auto size = [&](size_t axis) { return x.shape[order[axis]]; };
    const auto step = [&](size_t axis) { return strides[order[axis]]; };
    for (int64_t i = 0; i < size(0); ++i)
      for (int64_t j = 0; j < size(1); ++j)
        for (int64_t k = 0; k < size(2); ++k)
          for (int64_t l = 0; l < size(3); ++l)
            wanted.push_back(
                static_cast<float>(i * step(0) + j * step(1) + k * step(2) + l * step(3)));
    test::for_each_simd_target([&] {
      EXPECT_EQ(run_checked("Transpose", "transpose_param {" + dims + " }", {x})[0].values, wanted);
    });
  } while (std::ranges::next_permutation(order).found);
}

TEST(Reverse, AlongOneAxisOrSeveral) {
  const Tensor x = count_up({2, 1, 3});  // 0 1 2 | 3 4 5
  const auto reversed = [&](const std::string& axes) {
    const Tensor y = run_checked("Reverse", "reverse_param { " + axes + " }", {x})[0];
    EXPECT_EQ(y.shape, x.shape);
    return y.values;
  };
  expect_near(reversed(""), {3, 4, 5, 0, 1, 2});
  expect_near(reversed("axis: 0"), {3, 4, 5, 0, 1, 2});
  expect_near(reversed("axis: 1"), x.values);
  expect_near(reversed("axis: 2"), {2, 1, 0, 5, 4, 3});
  expect_near(reversed("axis: -1"), {2, 1, 0, 5, 4, 3});
  expect_near(reversed("axis: 2 axis: 0"), {5, 4, 3, 2, 1, 0});
  EXPECT_EQ(run("Reverse", "reverse_param { axis: 2 }", {2, 2, 2, 3}, count_up({24}).values),
            (std::vector<float>{3,  4,  5,  0,  1,  2,  9,  10, 11, 6,  7,  8,
                                15, 16, 17, 12, 13, 14, 21, 22, 23, 18, 19, 20}));
  expect_error<InputError>([&] { reversed("axis: 3"); }, {"reverse axis 3", "2x1x3"});
  expect_error<InputError>([&] { reversed("axis: -4"); }, {"reverse axis -4"});
  expect_error<InputError>([&] { reversed("axis: 2 axis: -1"); }, {"axis 2", "twice"});
  expect_rejected("Reverse", "", {Shape{}}, {"axis 0"});
}

TEST(Flip, MirrorsRowsAndColumns) {
  const Tensor x = count_up({1, 2, 2, 3});  // 0 1 2 / 3 4 5 | 6 7 8 / 9 10 11
  const auto flipped = [](const std::string& param, const Tensor& input) {
    return run_checked("Flip", "flip_param { " + param + " }", {input})[0].values;
  };
  expect_near(flipped("", x), {2, 1, 0, 5, 4, 3, 8, 7, 6, 11, 10, 9});
  expect_near(flipped("flip_height: true", x), {5, 4, 3, 2, 1, 0, 11, 10, 9, 8, 7, 6});
  expect_near(flipped("flip_height: true flip_width: false", x),
              {3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8});
  expect_near(flipped("flip_width: false", x), x.values);
  expect_near(flipped("flip_height: true", count_up({1, 2, 2})), {1, 0, 3, 2});
  expect_near(flipped("flip_height: true", count_up({2, 2})), {0, 1, 2, 3});
  expect_near(flipped("", count_up({})), {0});
  expect_error<InputError>(
      [&] {
        flipped("", count_up({1, 1, 1, 1, 2}));
      },
      {"4 axes", "1x1x1x1x2"});
}

TEST(Reorg, MovesPixelsAsDarknetDoes) {
  const auto reorg = [](const std::string& param, const Tensor& input) {
    return run_checked("Reorg", "reorg_param { " + param + " }", {input})[0];
  };
  // The sixteen values in rows of four, of which each channel takes every other row and column.
  const Tensor apart = reorg("", count_up({1, 4, 2, 2}));
  EXPECT_EQ(apart.shape, (Shape{1, 16, 1, 1}));
  expect_near(apart.values, {0, 2, 8, 10, 1, 3, 9, 11, 4, 6, 12, 14, 5, 7, 13, 15});
  // Channel s oh + ow gives row s j + oh, column s i + ow.
  const Tensor together = reorg("stride: 2 reverse: true", count_up({1, 4, 2, 2}));
  EXPECT_EQ(together.shape, (Shape{1, 1, 4, 4}));
  expect_near(together.values, {0, 4, 1, 5, 8, 12, 9, 13, 2, 6, 3, 7, 10, 14, 11, 15});
  // Channel 1 of the output holds every second channel of the input, in each image.
  const Tensor two = reorg("reverse: true", count_up({2, 8, 1, 1}));
  EXPECT_EQ(two.shape, (Shape{2, 2, 2, 2}));
  expect_near(two.values, {0, 2, 4, 6, 1, 3, 5, 7, 8, 10, 12, 14, 9, 11, 13, 15});
  const Tensor odd = count_up({2, 9, 6, 3});
  EXPECT_EQ(reorg("stride: 1", odd).values, odd.values);
  EXPECT_EQ(reorg("stride: 3", odd).shape, (Shape{2, 81, 2, 1}));
}

/// Slow twin: the formulas of the fork's loops.
TEST(DepthToSpace, MovesChannelsToBlocks) {
  constexpr int64_t kBlock = 3, kChannels = 2, kH = 2, kW = 4;
  const Tensor input = count_up({2, kChannels * kBlock * kBlock, kH, kW});
  for (const std::string format : {"NCHW", "DCR", "CRD"}) {
    const Tensor found = run_checked(
        "DepthToSpace", "depth_to_space_param { block_size: 3 data_format: '" + format + "' }",
        {input})[0];
    ASSERT_EQ(found.shape, (Shape{2, kChannels, kH * kBlock, kW * kBlock}));
    size_t i = 0;
    for (int64_t n = 0; n < 2; ++n)
      for (int64_t c = 0; c < kChannels; ++c)
        for (int64_t y = 0; y < kH * kBlock; ++y)
          for (int64_t x = 0; x < kW * kBlock; ++x, ++i) {
            const int64_t within = y % kBlock * kBlock + x % kBlock;
            const int64_t from =
                format == "CRD" ? c * kBlock * kBlock + within : within * kChannels + c;
            const int64_t at = ((n * input.shape[1] + from) * kH + y / kBlock) * kW + x / kBlock;
            ASSERT_EQ(found.values[i], input.values[at]) << format << ' ' << i;
          }
  }
  expect_rejected<UnsupportedError>("DepthToSpace", "depth_to_space_param { block_size: 2 }",
                                    {Shape{1, 4, 1, 1}}, {"'NHWC'"});
  expect_rejected("DepthToSpace", "depth_to_space_param { block_size: 0 data_format: 'CRD' }",
                  {Shape{1, 4, 1, 1}}, {"block_size must be at least 1"});
  expect_rejected("DepthToSpace", "depth_to_space_param { block_size: 2 data_format: 'CRD' }",
                  {Shape{1, 6, 1, 1}}, {"block_size 2", "found 6"});
}

TEST(Reorg, RejectsReadsBeyondTheInput) {
  const auto refused = [](const std::string& param, const Shape& input,
                          std::initializer_list<std::string> reasons) {
    expect_rejected("Reorg", "reorg_param { " + param + " }", {input}, reasons);
  };
  refused("stride: 0", {1, 4, 2, 2}, {"stride"});
  refused("", {4, 2, 2}, {"4 axes", "4x2x2"});
  refused("", {1, 4, 3, 2}, {"rows and columns", "stride 2", "found 3 and 2"});
  refused("", {1, 4, 2, 3}, {"found 2 and 3"});
  refused("", {1, 6, 2, 2}, {"channels", "1x6x2x2", "found 6"});
  refused("reverse: true", {1, 2, 2, 2}, {"channels", "found 2"});
  refused("stride: 4294967295", {1, 4, 2, 2}, {"channels"});
}

TEST(ShuffleChannel, TransposesGroups) {
  expect_near(
      run("ShuffleChannel", "shuffle_channel_param { group: 2 }", {1, 6, 1, 1}, {0, 1, 2, 3, 4, 5}),
      {0, 3, 1, 4, 2, 5});
  expect_near(run("ShuffleChannel", "shuffle_channel_param { group: 3 }", {1, 6, 1, 2},
                  count_up({12}).values),
              {0, 1, 4, 5, 8, 9, 2, 3, 6, 7, 10, 11});
  expect_rejected("ShuffleChannel", "shuffle_channel_param { group: 4 }", {Shape{1, 6}},
                  {"6 channels", "group 4"});
  expect_rejected("ShuffleChannel", "shuffle_channel_param { group: 0 }", {}, {"group"});
}

TEST(DummyData, ConstantsOfAnyShape) {
  const auto blobs = run_checked("DummyData",
                                 "dummy_data_param { data_filler { value: 1.5 } data_filler {} "
                                 "shape { dim: 2 } shape {} }",
                                 {}, {}, 2);
  expect_near(blobs[0].values, {1.5F, 1.5F});
  EXPECT_EQ(blobs[1].shape, Shape{});
  expect_near(blobs[1].values, {0});
  EXPECT_EQ(run_checked("DummyData",
                        "dummy_data_param { num: 1 channels: 2 height: 3 height: 4 width: 5 }", {},
                        {}, 2)[1]
                .shape,
            (Shape{1, 2, 4, 5}));
}

TEST(DummyData, RefusesRandomFillersAndOddCounts) {
  const auto infer = [](const std::string& param, size_t outputs = 1) {
    layer_of("DummyData", "dummy_data_param { " + param + " }")->infer({}, outputs);
  };
  expect_error<UnsupportedError>(
      [&] { infer("data_filler { type: 'gaussian' } shape { dim: 1 }"); }, {"'gaussian'"});
  expect_error<InputError>([&] { infer("data_filler { sparse: 3 } shape { dim: 1 }"); },
                           {"sparse"});
  expect_error<InputError>([&] { infer(""); }, {"shape is given 0 times"});
  expect_error<InputError>([&] { infer("shape {} shape {}", 3); }, {"shape is given 2 times"});
  expect_error<InputError>([&] { infer("data_filler {} data_filler {} shape {}", 3); },
                           {"data_filler is given 2 times"});
  expect_error<InputError>([&] { infer("num: 1 channels: 1 height: 1"); }, {"width"});
  expect_error<InputError>([&] { infer("num: 1 shape { dim: 1 }"); }, {"not both"});
  expect_error<InputError>([&] { infer("shape { dim: 0 }"); }, {"below 1"});
}

TEST(Parameter, IsItsWeights) {
  const auto blob =
      run_checked("Parameter", "parameter_param { shape { dim: 1 dim: 3 } }", {}, {{1, 2, 3}})[0];
  EXPECT_EQ(blob.shape, (Shape{1, 3}));
  expect_near(blob.values, {1, 2, 3});
}

TEST(MovingLayers, KnowWhichPixelsTheySee) {
  const auto window = [](const std::string& type, const std::string& param) {
    return layer_of(type, param)->window(Shape{1, 4, 5, 6});
  };
  const auto crop = window("Crop", "crop_param { offset: 1 offset: 2 }");
  ASSERT_TRUE(crop.has_value());
  EXPECT_EQ(crop->h.pad, -1);  // output row 0 is input row 1
  EXPECT_EQ(crop->w.pad, -2);
  EXPECT_EQ(window("Crop", "crop_param { axis: 3 offset: 2 }")->h.pad, 0);
  EXPECT_TRUE(window("Slice", ""));
  EXPECT_FALSE(window("Slice", "slice_param { axis: 2 }"));
  EXPECT_TRUE(window("Tile", "tile_param { tiles: 2 }"));
  EXPECT_FALSE(window("Tile", "tile_param { axis: -1 tiles: 2 }"));
  const auto center = window(
      "CropCenter", "crop_center_param { crop_size: 0 crop_size: 0 crop_size: 3 crop_size: 2 }");
  EXPECT_EQ(center->h.pad, -3);
  EXPECT_EQ(center->w.pad, -2);
  EXPECT_TRUE(window("ShuffleChannel", ""));
  EXPECT_FALSE(window("Permute", ""));
  EXPECT_TRUE(window("Reverse", "reverse_param { axis: 0 axis: 1 }"));
  EXPECT_FALSE(window("Reverse", "reverse_param { axis: 0 axis: 3 }"));
  EXPECT_FALSE(window("Flip", ""));
  EXPECT_FALSE(window("Reorg", ""));
  EXPECT_FALSE(window("Reshape", ""));
}

TEST(Silence, TakesAnythingAndGivesNothing) {
  EXPECT_TRUE(layer_of("Silence", "")->infer({Shape{2}, Shape{}}, 0).empty());
  expect_rejected("Silence", "", {Shape{2}}, {"0 outputs"});
  expect_rejected("Silence", "", {}, {"at least one input"}, 0);
}

}  // namespace
}  // namespace revisit::engine

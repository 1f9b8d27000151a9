#include "revisit/engine/net.h"
#include "single_layer.h"
#include "testing.h"

namespace revisit::engine {
namespace {

const float kLn2 = std::log(2.0F), kLn3 = std::log(3.0F), kLn4 = std::log(4.0F);

/// A map of 1 x 2 cells of 10 pixels, one box of 4 x 5 pixels and two classes. Channels: x, y, w,
/// h, object, classes; sigmoid(0) is a half, sigmoid(ln 3) three quarters.
test::SingleLayer yolo_v3(const std::vector<float>& channels, const std::string& more = "") {
  return {"Yolov3DetectionOutput",
          "yolov3_detection_output_param { num_classes: 2 num_box: 1 biases: [9, 9, 4, 5] mask: 1 "
          "mask_group_num: 1 anchors_scale: 10 " +
              more + " }",
          {{Shape{1, 7, 1, 2}, channels}}};
}

TEST(Yolov3DetectionOutput, ByHand) {
  // The first cell: center (0.5 / 2, 0.5), size (4 / 20, 2 * 5 / 10). Class 2 suppresses class 1,
  // which has a lower score. The second cell: center (1.75 / 2, 0.5), size (4 / 20, 5 / 10),
  // class 1.
  const auto found = run_layer(yolo_v3({0, kLn3,    //
                                        0, 0,       //
                                        0, 0,       //
                                        kLn2, 0,    //
                                        0, -kLn3,   //
                                        0, 0,       //
                                        kLn3, -9},  //
                                       "confidence_threshold: 0.1"));
  EXPECT_EQ(found[0].shape, (Shape{1, 1, 2, 7}));
  expect_near(found[0].values,
              {0, 2, 0.375F, 0.15F, 0, 0.35F, 1, 0, 1, 0.125F, 0.775F, 0.25F, 0.975F, 0.75F},
              1e-6F);
}

/// An overlap of 0 is at the threshold 0.
TEST(Yolov3DetectionOutput, SuppressesAtTheThreshold) {
  std::vector<float> channels(14, 0);
  EXPECT_EQ(run_layer(yolo_v3(channels, "nms_threshold: 0.01"))[0].shape[2], 2);
  EXPECT_EQ(run_layer(yolo_v3(channels, "nms_threshold: 0"))[0].shape[2], 1);
}

TEST(Yolov3DetectionOutput, NothingIsARowOfMinusOnes) {
  const std::vector<float> nothing{0, -1, -1, -1, -1, -1, -1}, nan(14, kNan);
  // Every score is a quarter: a score must be above the threshold.
  expect_near(run_layer(yolo_v3(std::vector<float>(14, 0), "confidence_threshold: 0.25"))[0].values,
              nothing);
  expect_near(run_layer(yolo_v3(nan))[0].values, nothing);
}

/// Both cells have the box of the whole width 2 around x = 0.25 or 0.75: 1.5 of 2.5 overlap.
TEST(Yolov3DetectionOutput, SuppressesOtherClassesAndTakesTheEarlierOfEqualScores) {
  std::vector<float> channels(14, 0);
  channels[4] = channels[5] = std::log(10.0F);
  const auto scores = [&](const std::string& threshold) {
    std::vector<float> places;
    const auto found = run_layer(yolo_v3(channels, "nms_threshold: " + threshold));
    for (size_t i = 0; i < found[0].values.size(); i += 7) {
      places.push_back(found[0].values[i + 1]);
      places.push_back((found[0].values[i + 3] + found[0].values[i + 5]) / 2);
    }
    return places;
  };
  expect_near(scores("0.59"), {1, 0.25F}, 1e-6F);
  expect_near(scores("0.61"), {1, 0.25F, 1, 0.75F}, 1e-6F);
  expect_near(scores("1.1"), {1, 0.25F, 2, 0.25F, 1, 0.75F, 2, 0.75F}, 1e-6F);
}

TEST(Yolov3DetectionOutput, BoxesWithoutAnEndSuppressNothing) {
  std::vector<float> channels(14, 0);
  channels[4] = 1000;  // the first box is infinitely wide
  const auto found = run_layer(yolo_v3(channels));
  EXPECT_EQ(found[0].shape, (Shape{1, 1, 3, 7}));
  expect_near({found[0].values.begin(), found[0].values.begin() + 7},
              {0, 1, 0.25F, -kInf, 0.25F, kInf, 0.75F});
}

TEST(Yolov3DetectionOutput, MapsHaveTheirOwnAnchors) {
  // The first map has cells of 32 pixels and the anchor 64 x 32, the second of 16 and 8 x 16.
  const std::vector<float> map(6, 0);
  const auto found =
      run_layer({"Yolov3DetectionOutput",
                 "yolov3_detection_output_param { num_classes: 1 num_box: 1 biases: [8, 16, 64, "
                 "32] mask: [1, 0] mask_group_num: 2 anchors_scale: [32, 16] nms_threshold: 2 }",
                 {{Shape{1, 6, 1, 1}, map}, {Shape{1, 6, 1, 1}, map}}});
  expect_near(found[0].values, {0, 1, 0.25F, -0.5F, 0, 1.5F, 1, 0, 1, 0.25F, 0.25F, 0, 0.75F, 1},
              1e-6F);
}

TEST(Yolov3DetectionOutput, RejectsInvalidParameters) {
  const auto make = [](const std::string& param) {
    return [=] {
      layer_of(
          "Yolov3DetectionOutput",
          "yolov3_detection_output_param { anchors_scale: 32 mask_group_num: 1 " + param + " }");
    };
  };
  const std::string mask = " mask: [0, 1, 2] ", classes = " num_classes: 2 ";
  const std::string biases = " biases: [1, 2, 3, 4, 5, 6] ";
  EXPECT_NO_THROW(make(mask + classes + biases)());
  expect_error<InputError>(make(mask + biases), {"num_classes"});
  expect_error<InputError>(make(mask + biases + classes + "num_box: 0"), {"num_box"});
  expect_error<InputError>(make("mask: 0" + biases + classes),
                           {"1 mask groups x 3 boxes, found 1"});
  expect_error<InputError>(make("mask: [0, 1, 3]" + biases + classes),
                           {"at least 8 biases", "4 anchors, found 6"});
  expect_error<InputError>(make(mask + biases + classes + "anchors_scale: 16"),
                           {"1 mask groups, found 2"});
  expect_rejected("Yolov3DetectionOutput",
                  "yolov3_detection_output_param { mask_group_num: 0 num_classes: 2 }", {},
                  {"mask_group_num must be at least 1"});
  expect_error<UnsupportedError>(make(mask + biases + classes + "gaussian_box: true"),
                                 {"gaussian_box"});
  const auto infer = [](std::vector<Shape> inputs) {
    return [=] { layer_of("Yolov3DetectionOutput", yolo_v3({}).param)->infer(inputs, 1); };
  };
  const Shape map{1, 7, 3, 2};
  EXPECT_EQ(layer_of("Yolov3DetectionOutput", yolo_v3({}).param)->infer({map}, 1)[0],
            (Shape{1, 1, 12, 7}));
  expect_error<InputError>(infer({map, map}), {"expected 1 inputs (mask_group_num)", "2"});
  expect_error<InputError>(infer({Shape{2, 7, 3, 2}}), {"batch of 1 image, found 2"});
  expect_error<InputError>(infer({Shape{1, 8, 3, 2}}), {"expected 7 channels", "1x8x3x2"});
  expect_error<InputError>(infer({Shape{1, 7}}), {"4 axes"});
  expect_error<InputError>(infer({Shape{1, 7, 300'000'000, 1}}), {"anchors_scale"});
}

/// One cell, one box of 2 x 1 cells, two classes by default.
test::SingleLayer yolo_v2(std::vector<Tensor> maps, const std::string& more = "") {
  return {"YoloDetectionOutput",
          "yolo_detection_output_param { num_classes: 2 num_box: 1 biases: [2, 1] " + more + " }",
          std::move(maps)};
}

TEST(YoloDetectionOutput, ByHand) {
  // Classes are 1 to 3 after the softmax, the object is 0.75; corners (0.5, 0.75) +- (2, 1) / 2.
  const Tensor one{Shape{1, 7, 1, 1}, {0, kLn3, 0, 0, kLn3, 0, kLn3}};
  expect_near(run_layer(yolo_v2({one}))[0].values, {0, 2, 0.5625F, -0.5F, 0.25F, 1.5F, 1.25F},
              1e-6F);
  // A second map of 2 x 2 cells, of which one has an object: center (0.5 + 1) / 2, size (1, 0.5).
  // Equal scores: the first class.
  Tensor two{Shape{1, 7, 2, 2}, std::vector<float>(28, 0)};
  for (size_t cell = 0; cell < 4; ++cell) two.values[16 + cell] = cell == 3 ? 0.0F : -kInf;
  expect_near(run_layer(yolo_v2({one, two}))[0].values,
              {0, 2, 0.5625F, -0.5F, 0.25F, 1.5F, 1.25F,  //
               0, 1, 0.25F, 0.25F, 0.5F, 1.25F, 1},
              1e-6F);
  EXPECT_EQ(run_layer(yolo_v2({one, two}, "confidence_threshold: 0.25"))[0].shape[2], 2);
  EXPECT_EQ(run_layer(yolo_v2({one, two}, "confidence_threshold: 0.26"))[0].shape[2], 1);
}

TEST(YoloDetectionOutput, NanIsNeverDetected) {
  const std::vector<float> nothing{0, -1, -1, -1, -1, -1, -1};
  for (const size_t channel : {4, 5, 6}) {
    Tensor map{Shape{1, 7, 1, 1}, std::vector<float>(7, 9)};
    map.values[channel] = kNan;
    expect_near(run_layer(yolo_v2({map}))[0].values, nothing);
  }
}

TEST(YoloDetectionOutput, RejectsInvalidParameters) {
  const auto make = [](const std::string& param) {
    return
        [=] { layer_of("YoloDetectionOutput", "yolo_detection_output_param { " + param + " }"); };
  };
  expect_error<InputError>(make("biases: [1, 2]"), {"num_classes"});
  expect_error<InputError>(make("num_classes: 2 biases: [1, 2]"),
                           {"at least 10 biases", "5 anchors, found 2"});
  expect_error<InputError>(make("num_classes: 2 num_box: 1 biases: [1, 2] coords: 5"),
                           {"coords must be 4, found 5"});
  const auto infer = [](std::vector<Shape> inputs) {
    return [=] { layer_of("YoloDetectionOutput", yolo_v2({}).param)->infer(inputs, 1); };
  };
  expect_error<InputError>(infer({Shape{1, 7, 3, 2}}), {"expected a square map", "1x7x3x2"});
  expect_error<InputError>(infer({}), {"1 or 2 inputs, found 0"});
  const Shape large{1, 1005, 1400, 1400};
  expect_rejected("YoloDetectionOutput",
                  "yolo_detection_output_param { num_classes: 1000 num_box: 1 biases: [1, 1] }",
                  {large, large}, {"boxes times classes must be at most", "3920000000"});
}

/// Maps of cells of 16 pixels with boxes of 20 x 40, and two classes: channels of the background,
/// of the other, and of x, y, w, h.
test::SingleLayer box_output(std::vector<Tensor> maps, const std::string& more = "") {
  std::string scales;
  for (size_t i = 0; i < maps.size(); ++i) scales += " field_w: 20 field_h: 40 downsample_rate: 16";
  return {.type = "BoxOutput",
          .param = "box_output_param { " + scales + " " + more + " }",
          .inputs = std::move(maps),
          .n_outputs = 2};
}

TEST(BoxOutput, ByHand) {
  // 2 x 4 cells are an image of 64 x 32. Cell (1, 2) has its center at (40, 24); it moves by half a
  // field at most, (0.25 * 20, -0.5 * 40), to (45, 4), and has (20, 40 / 2), half at least: it goes
  // from (35, -6) and is cut to (35, 0); its height of 20 then ends at 20.
  Tensor map{Shape{1, 6, 2, 4}, std::vector<float>(48, 0)};
  const size_t cell = 6;
  for (size_t i = 0; i < 8; ++i) map.values[i] = i == cell ? 0.5F : 9;  // the background
  map.values[8 + cell] = 2;
  map.values[16 + cell] = 0.25F;
  map.values[24 + cell] = -5;
  map.values[40 + cell] = -kInf;
  const auto found = run_layer(box_output({map}));
  EXPECT_EQ(found[0].shape, (Shape{1, 5, 1, 1}));
  EXPECT_EQ(found[1].shape, (Shape{1, 6, 1, 1}));
  expect_near(found[0].values, {0, 35, 0, 55, 20}, 1e-5F);
  expect_near(found[1].values, {0, 35, 0, 55, 20, 1.5F}, 1e-5F);
  EXPECT_EQ(run_layer(box_output({map}, "min_size: 20.1"))[0].values[3], 10);
  EXPECT_EQ(run_layer(box_output({map}, "fg_thr: 1.6"))[0].values[3], 10);
}

TEST(BoxOutput, MeansAndDeviationsOfOffsets) {
  Tensor map{Shape{1, 6, 4, 4}, std::vector<float>(96, 0)};
  for (size_t i = 0; i < 16; ++i) map.values[i] = 1;
  map.values[16 + 5] = 2;  // the cell (1, 1), center (24, 24)
  map.values[32 + 5] = 1;
  auto layer = box_output({map});
  // 20 * (0.5 * 1 - 0.25) to the right; half as high.
  layer.param +=
      str(" bbox_reg_param { bbox_mean: [-0.25, 0, 0, ", -kLn2, "] bbox_std: [0.5, 1, 1, 1] }");
  expect_near(run_layer(layer)[0].values, {0, 19, 14, 39, 34}, 1e-4F);
}

TEST(BoxOutput, NothingIsOneSmallBox) {
  const Tensor map{Shape{2, 6, 1, 1}, std::vector<float>(12, kNan)};
  const auto found = run_layer(box_output({map, map}));
  expect_near(found[0].values, {0, 1, 1, 10, 10});
  expect_near(found[1].values, {0, 0, 0, 0, 0, 0});
}

/// Boxes of 20 x 40 pixels at the centers of 8 x 8 cells.
Tensor boxes_at(int64_t images, const std::vector<std::array<float, 4>>& image_cell_score_x) {
  Tensor map{Shape{images, 6, 8, 8}, std::vector<float>(static_cast<size_t>(images) * 384, 0)};
  for (int64_t i = 0; i < images * 64; ++i)
    map.values[static_cast<size_t>(i / 64 * 384 + i % 64)] = 99;
  for (const auto& [image, cell, score, x] : image_cell_score_x) {
    const auto first = static_cast<size_t>(image * 384 + cell);
    map.values[first] = 0;
    map.values[first + 64] = score;
    map.values[first + 128] = x;
  }
  return map;
}

std::vector<std::vector<float>> rows_of(const std::vector<Tensor>& found) {
  std::vector<std::vector<float>> rows;
  for (size_t i = 0; i < found[0].values.size(); i += 5)
    rows.push_back({found[0].values[i], found[0].values[i + 1]});  // image and left edge
  return rows;
}

TEST(BoxOutput, BestFirstByImageAndTheLaterOfEqualScores) {
  using Rows = std::vector<std::vector<float>>;
  // In both images boxes around (56, 56), (72, 56), (88, 56); they share 4 of 36 columns.
  const std::vector<Tensor> maps{
      boxes_at(2, {{0, 27, 1, 0}, {0, 28, 3, 0}, {0, 29, 3, 0}, {1, 27, 5, 0}})};
  const std::string none = "iou_thr: 0.9 ";
  EXPECT_EQ(rows_of(run_layer(box_output(maps, none))), (Rows{{0, 78}, {0, 62}, {0, 46}, {1, 46}}));
  EXPECT_EQ(rows_of(run_layer(box_output(maps, none + "max_nms_num: 2"))),
            (Rows{{0, 78}, {0, 62}, {1, 46}}));
  EXPECT_EQ(rows_of(run_layer(box_output(maps, none + "max_post_nms_num: 1"))),
            (Rows{{0, 78}, {1, 46}}));
  // 4 / 36 is above 0.1: the second goes, the third stays. The share of the smaller box is a fifth.
  EXPECT_EQ(rows_of(run_layer(box_output(maps, "iou_thr: 0.1"))),
            (Rows{{0, 78}, {0, 46}, {1, 46}}));
  EXPECT_EQ(rows_of(run_layer(box_output(maps, "iou_thr: 0.19"))).size(), 4U);
  for (const std::string type : {"IOMU", "IOFU"}) {
    const std::string of = "nms_type: '" + type + "' iou_thr: ";
    EXPECT_EQ(rows_of(run_layer(box_output(maps, of + "0.19"))).size(), 3U) << type;
    EXPECT_EQ(rows_of(run_layer(box_output(maps, of + "0.21"))).size(), 4U) << type;
  }
}

TEST(BoxOutput, OverlapOfTheBetterBoxOrOfTheSmaller) {
  const auto count = [](bool large_first, const std::string& type) {
    Tensor map = boxes_at(1, {{0, 27, 1, 0}, {0, 28, 2, -0.5F}});
    map.values[large_first ? 28 + 256 : 27 + 256] = kLn2;
    return rows_of(run_layer(box_output({map}, "iou_thr: 0.6 nms_type: '" + type + "'"))).size();
  };
  for (const bool large_first : {false, true}) {
    EXPECT_EQ(count(large_first, "IOMU"), 1U);
    EXPECT_EQ(count(large_first, "IOU"), 2U);
  }
  EXPECT_EQ(count(false, "IOFU"), 1U);
  EXPECT_EQ(count(true, "IOFU"), 2U);
}

TEST(BoxOutput, RejectsInvalidParameters) {
  const auto infer = [](const std::string& param, std::vector<Shape> inputs, size_t outputs) {
    return [=] {
      layer_of("BoxOutput", "box_output_param { " + param + " }")->infer(inputs, outputs);
    };
  };
  const Shape map{1, 6, 2, 2};
  const std::string one = "field_w: 1 field_h: 1 downsample_rate: 8 ";
  EXPECT_NO_THROW(infer(one, {map}, 1)());
  expect_error<InputError>(infer("", {}, 1), {"as many field_w", "0, 0 and 0"});
  expect_error<InputError>(infer(one + "field_h: 3", {map}, 1), {"1, 2 and 1"});
  expect_error<InputError>(infer("field_w: 1 field_h: 1 downsample_rate: 0", {map}, 1), {"stride"});
  expect_error<InputError>(infer(one + "field_whr: 0", {map}, 1), {"field_whr"});
  expect_error<InputError>(infer(one + "field_xyr: nan", {map}, 1), {"field_xyr"});
  expect_error<InputError>(infer(one, {map, map}, 1), {"expected 1 inputs"});
  expect_error<InputError>(infer(one, {map}, 3), {"1 or 2 outputs", "found 3"});
  expect_error<InputError>(infer(one, {Shape{1, 5, 2, 2}}, 1), {"2 classes + 4", "1x5x2x2"});
  expect_error<InputError>(infer(one + one, {map, Shape{2, 6, 2, 2}}, 1), {"1x6x2x2", "2x6x2x2"});
  expect_rejected("BoxOutput",
                  "box_output_param { " + one + "} bbox_reg_param { bbox_mean: 0 bbox_std: 1 }", {},
                  {"4 bbox_mean and 4 bbox_std, found 1 and 1"});
}

/// Two boxes a cell, of 20 x 20 and 40 x 20, on 4 x 4 cells of 16 pixels; nothing is foreground.
struct Groups {
  Tensor scores{Shape{2, 2, 4, 4}, std::vector<float>(64, 1)};
  Tensor offsets{Shape{2, 4, 4, 4}, std::vector<float>(128, 0)};

  test::SingleLayer layer(const std::string& more = "") const {
    return {.type = "BoxGroupOutput",
            .param =
                "box_group_output_param { fg_thr: 0.1 box_group_param { field_w: [20, 40] "
                "field_h: [20, 20] stride: 16 } " +
                more + " }",
            .inputs = {scores, offsets},
            .n_outputs = 2};
  }
};

TEST(BoxGroupOutput, ByHand) {
  // The second field of cell (1, 2), center (40, 24): from (20, 14) to the last pixel (59, 33).
  // The first of cell (0, 3), center (56, 8), 0.5 * 20 down: from (46, 8), it ends at 65, cut
  // to 64.
  Groups g;
  g.scores.values[32 + 6] = 0.25F;
  g.scores.values[3] = 0.5F;
  g.offsets.values[16 + 3] = 0.5F;
  const auto found = run_layer(g.layer());
  EXPECT_EQ(found[0].shape, (Shape{2, 5, 1, 1}));
  expect_near(found[0].values, {0, 20, 14, 59, 33, 0, 46, 8, 64, 27}, 1e-5F);
  expect_near(found[1].values, {0, 20, 14, 59, 33, 0.75F, 0, 46, 8, 64, 27, 0.5F}, 1e-5F);
}

TEST(BoxGroupOutput, NothingIsOneSmallBox) {
  const auto found = run_layer(Groups().layer());
  expect_near(found[0].values, {0, 1, 1, 10, 10});
  expect_near(found[1].values, {0, 0, 0, 0, 0, 0});
}

TEST(BoxGroupOutput, EqualScoresByOrderAndBothEndsBelongToABox) {
  // Boxes of 20 x 20 at (14, 14) and (30, 14): 4 of 36 columns with both ends, the overlap is 1
  // / 9.
  Groups g;
  g.scores.values[5] = g.scores.values[6] = 0.5F;
  const auto lefts = [&](const std::string& more) {
    std::vector<float> x;
    const auto found = run_layer(g.layer(more));
    for (size_t i = 1; i < found[0].values.size(); i += 5) x.push_back(found[0].values[i]);
    return x;
  };
  EXPECT_EQ(lefts("iou_thr: 0.112"), (std::vector<float>{14, 30}));
  EXPECT_EQ(lefts("iou_thr: 0.11"), (std::vector<float>{14}));
  EXPECT_EQ(lefts("max_nms_num: 1"), (std::vector<float>{14}));
  EXPECT_EQ(lefts("max_post_nms_num: 1"), (std::vector<float>{14}));
  EXPECT_EQ(lefts("min_size: 20"), (std::vector<float>{14, 30}));
  EXPECT_EQ(lefts("min_size: 20.1"), (std::vector<float>{1}));
}

TEST(BoxGroupOutput, ItemsAreImagesOfFields) {
  Groups g;
  g.scores = {Shape{4, 2, 4, 4}, std::vector<float>(128, 1)};
  g.offsets = {Shape{4, 4, 4, 4}, std::vector<float>(256, 0)};
  g.scores.values[3 * 32 + 6] = 0.25F;  // the second field of the second image
  expect_near(run_layer(g.layer())[0].values, {1, 20, 14, 59, 33}, 1e-5F);
}

TEST(BoxGroupOutput, RejectsInvalidParameters) {
  const auto infer = [](const std::string& param, std::vector<Shape> inputs) {
    return [=] {
      layer_of("BoxGroupOutput", "box_group_output_param { " + param + " }")->infer(inputs, 1);
    };
  };
  const std::string two = "box_group_param { field_w: [1, 2] field_h: [1, 2] stride: 8 }";
  const Shape scores{4, 2, 3, 3}, offsets{4, 4, 3, 3};
  EXPECT_NO_THROW(infer(two, {scores, offsets})());
  expect_error<InputError>(infer("", {}), {"box_group_param"});
  expect_error<InputError>(infer("box_group_param { field_w: 1 stride: 8 }", {}), {"1 and 0"});
  expect_error<InputError>(infer("box_group_param { field_w: 1 field_h: 1 }", {}), {"stride"});
  expect_error<InputError>(infer(two, {scores}), {"expected 2 inputs"});
  expect_error<InputError>(infer(two, {Shape{3, 2, 3, 3}, offsets}), {"2 boxes of 1 images"});
  expect_error<InputError>(infer(two, {scores, scores}), {"4x4x3x3", "4x2x3x3"});
}

TEST(DecodeBBox, ByHand) {
  // A region of 10 x 20 pixels, both ends included, around (14.5, 29.5). It moves by (0.5 * 10, 0)
  // and becomes 20 x 20: from 19.5 - 19 / 2 to the last pixel, 29. The second is one pixel.
  const Tensor offsets{Shape{2, 8}, {9, 9, 9, 9, 5, 0, 0, 1, 9, 9, 9, 9, 0, 0, 0, kNan}};
  const Tensor regions{Shape{2, 5, 1, 1}, {3, 10, 20, 19, 39, 0, 0, 0, 0, 0}};
  const auto found = run_layer({"DecodeBBox",
                                str("bbox_reg_param { bbox_mean: [0, 0, ", kLn2, ", ", -kLn4,
                                    "] bbox_std: [0.1, 0.1, 0.2, ", kLn4, "] }"),
                                {offsets, regions}});
  EXPECT_EQ(found[0].shape, (Shape{2, 5, 1, 1}));
  expect_near(found[0].values, {3, 10, 20, 29, 39, 0, -0.5F, kNan, 0.5F, kNan}, 1e-5F);
}

TEST(DecodeBBox, RejectsInvalidParameters) {
  const auto infer = [](std::vector<Shape> inputs) {
    return [=] { layer_of("DecodeBBox", "")->infer(inputs, 1); };
  };
  EXPECT_EQ(layer_of("DecodeBBox", "")->infer({Shape{3, 8, 1, 1}, Shape{3, 5}}, 1)[0],
            (Shape{3, 5, 1, 1}));
  expect_error<InputError>(infer({Shape{3, 4}, Shape{3, 5}}), {"8 offsets", "3x4 and 3x5"});
  expect_error<InputError>(infer({Shape{3, 8}, Shape{2, 5}}), {"3x8 and 2x5"});
  expect_error<InputError>(infer({Shape{3, 8}, Shape{3, 5}, Shape{3, 5}}),
                           {"third is for training"});
  expect_error<UnsupportedError>([] { layer_of("DecodeBBox", "phase: TRAIN"); }, {"phase: TRAIN"});
  expect_rejected("DecodeBBox", "bbox_reg_param { bbox_mean: [0, 0, 0, 0] bbox_std: [1, 1, 0, 1] }",
                  {}, {"bbox_std", "found 0"});
}

/// A map of 3 x 4 pixels, 10 * row + column. The value of pixel i is at i + 0.5.
Tensor rows_and_columns() {
  return {Shape{1, 1, 3, 4}, {0, 1, 2, 3, 10, 11, 12, 13, 20, 21, 22, 23}};
}

TEST(RoiAlign, ByHand) {
  // The corners of the first: x = 1, 2, 3 and y = 0.5, 1.5. A corner at the border of the map has
  // the value of the last pixel, one beyond it 0.
  const auto found = run_layer({"ROIAlign",
                                "roi_pooling_param { pooled_h: 1 pooled_w: 2 spatial_scale: 0.5 }",
                                {rows_and_columns(),
                                 {Shape{3, 5},
                                  {0, 2, 1, 6, 3,  //
                                   0, 0, 0, 8, 6,  //
                                   0, 4, 4, 12, 8}}}});
  EXPECT_EQ(found[0].shape, (Shape{3, 1, 2, 3}));
  expect_near(found[0].values, {0.5F, 1.5F, 2.5F, 10.5F, 11.5F, 12.5F,  //
                                0, 1.5F, 3, 20, 21.5F, 23,              //
                                16.5F, 18, 0, 0, 0, 0});
}

TEST(RoiAlign, PadsRegionsAndLeavesOutEmptyOnes) {
  // The first of 1.5 pixels, both ends included, is padded by half of that: from 1.25 to 3.25,
  // which is below the map. The second is inside out, the third of no image.
  const auto found = run_layer(
      {"ROIAlign",
       "roi_pooling_param { pooled_h: 1 pooled_w: 1 pad_ratio: 0.5 }",
       {rows_and_columns(),
        {Shape{4, 5}, {0, 2, 2, 2.5F, 2.5F, 0, 3, 0, 1, 2, 1, 0, 0, 2, 2, 0, 0, 0, kNan, 2}}}});
  expect_near(found[0].values,
              {8.25F, 10.25F, 0, 0, 0, 0, 0, 0, kNan, kNan, kNan, kNan, kNan, kNan, kNan, kNan},
              1e-5F);
}

TEST(BoxOutput, LayersOfRegionsFollowTheirNumber) {
  const TempDir dir;
  write_file(dir / "net.prototxt", R"(
    layer { name: "in" type: "Input" top: "map" top: "image"
            input_param { shape { dim: [1, 6, 8, 8] } shape { dim: [1, 1, 3, 4] } } }
    layer { name: "boxes" type: "BoxOutput" bottom: "map" top: "boxes"
            box_output_param { field_w: 20 field_h: 40 downsample_rate: 16 iou_thr: 0.9 } }
    layer { name: "align" type: "ROIAlign" bottom: "image" bottom: "boxes" top: "align"
            roi_pooling_param { pooled_h: 1 pooled_w: 3 } }
    layer { name: "rows" type: "Reshape" bottom: "align" top: "rows"
            reshape_param { shape { dim: [0, 8] } } }
    layer { name: "moved" type: "DecodeBBox" bottom: "rows" bottom: "boxes" top: "moved" }
  )");
  engine::Run run(Net::load_without_weights(dir / "net.prototxt").plan());
  EXPECT_EQ(run.plan().outputs()[0].shape, (Shape{64, 5, 1, 1}));
  const auto lefts = [&](const Tensor& map) {
    std::copy(map.values.begin(), map.values.end(), run.input("map").data);
    run.forward();
    std::vector<float> x;
    const auto view = run.output("moved").values();
    for (size_t i = 1; i < view.size(); i += 5) x.push_back(view[i]);
    return x;
  };
  std::fill_n(run.input("image").data, 12, 0.0F);  // no box moves
  EXPECT_EQ(lefts(boxes_at(1, {{0, 27, 1, 0}, {0, 28, 2, 0}})), (std::vector<float>{62, 46}));
  EXPECT_EQ(lefts(boxes_at(1, {{0, 29, 1, 0}})), (std::vector<float>{78}));
  EXPECT_EQ(lefts(boxes_at(1, {})), (std::vector<float>{1}));
}

}  // namespace
}  // namespace revisit::engine

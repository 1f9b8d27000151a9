#include "plan_impl.h"
#include "revisit/engine/net.h"
#include "testing.h"

namespace revisit::engine {
namespace {

TEST(ReceptiveField, ConvolutionsAddUp) {
  // AlexNet by hand: conv1 11/4 -> 11, 4; pool1 3/2 -> 11 + 2 * 4 = 19, 8; conv2 5 pad 2 -> 19 + 4
  // * 8 = 51
  const Field conv1 = field_through({ReceptiveField{}}, {11, 4, 0});
  EXPECT_EQ(conv1, (ReceptiveField{11, 4, 0}));
  const Field pool1 = field_through({conv1}, {3, 2, 0});
  EXPECT_EQ(pool1, (ReceptiveField{19, 8, 0}));
  EXPECT_EQ(field_through({pool1}, {5, 1, 2}), (ReceptiveField{51, 8, -16}));
}

TEST(ReceptiveField, SeveralInputsGiveTheUnion) {
  const Field joint = field_through({ReceptiveField{3, 2, 4}, ReceptiveField{5, 2, -1}}, {1, 1, 0});
  EXPECT_EQ(joint, (ReceptiveField{8, 2, -1}));  // [4, 7) and [-1, 4)
  EXPECT_EQ(field_through({ReceptiveField{3, 2, 0}, ReceptiveField{3, 4, 0}}, {1, 1, 0}),
            std::nullopt);
  EXPECT_EQ(field_through({std::nullopt}, {1, 1, 0}), std::nullopt);
}

/// Property: changing an input pixel changes exactly the outputs whose field contains it.
TEST(ReceptiveField, CoversTheOutputsOfAnInputPixel) {
  const TempDir dir;
  write_file(dir / "net.prototxt", R"(
    layer { name: "data" type: "Input" top: "data" input_param { shape { dim: 1 dim: 1 dim: 1 dim: 60 } } }
    layer { name: "a" type: "Convolution" bottom: "data" top: "a" convolution_param { num_output: 1 kernel_h: 1 kernel_w: 5 stride_h: 1 stride_w: 2 pad_h: 0 pad_w: 1 } }
    layer { name: "b" type: "Pooling" bottom: "a" top: "b" pooling_param { pool: AVE kernel_h: 1 kernel_w: 3 stride_h: 1 stride_w: 2 } }
    layer { name: "c" type: "Convolution" bottom: "b" top: "c" convolution_param { num_output: 1 kernel_h: 1 kernel_w: 2 dilation: 1 dilation: 3 pad_h: 0 pad_w: 2 } })");
  engine::Run run(Net::load_with_random_weights(dir / "net.prototxt", 5).plan());
  const ReceptiveField field = run.plan().layers().back().field_w.value();
  const auto forward = [&](int64_t changed) {
    for (float& value : run.input("data").values()) value = 1;
    if (changed >= 0) run.input("data").values()[static_cast<size_t>(changed)] = 50;
    run.forward();
    const auto out = run.output("c").values();
    return std::vector<float>(out.begin(), out.end());
  };
  const std::vector<float> plain = forward(-1);
  for (int64_t x = 0; x < 60; ++x) {
    const std::vector<float> touched = forward(x);
    for (size_t i = 0; i < plain.size(); ++i) {
      const int64_t begin = field.start + static_cast<int64_t>(i) * field.stride;
      if (touched[i] != plain[i]) {
        EXPECT_TRUE(begin <= x && x < begin + field.size)
            << "pixel " << x << " reaches output " << i;
      }
      if (x == begin || x == begin + field.size - 1) {
        EXPECT_NE(touched[i], plain[i])
            << "pixel " << x << " is at the edge of the field of output " << i;
      }
    }
  }
}

}  // namespace
}  // namespace revisit::engine

#include "revisit/engine/tensor.h"

#include "testing.h"

namespace revisit::engine {
namespace {

TEST(Shape, CountsElements) {
  const Shape shape{2, 3, 4, 5};
  EXPECT_EQ(shape.elements(), 120);
  EXPECT_EQ(shape.product(1, 3), 12);
  EXPECT_EQ(shape.text(), "2x3x4x5");
  EXPECT_EQ(Shape().elements(), 1);
  EXPECT_EQ(shape.with(0, 7), (Shape{7, 3, 4, 5}));
}

TEST(Shape, AxesCountFromTheEndWhenNegative) {
  const Shape shape{2, 3, 4};
  EXPECT_EQ(shape.canonical_axis(-1, "axis"), 2U);
  EXPECT_EQ(shape.canonical_axis(-3, "axis"), 0U);
  EXPECT_THROW(shape.canonical_axis(3, "axis"), InputError);
  EXPECT_THROW(shape.canonical_axis(-4, "axis"), InputError);
}

TEST(Shape, RefusesEmptyAndHugeOnes) {
  EXPECT_THROW((Shape{1, 0, 3}), InputError);
  EXPECT_THROW((Shape{1, -1}), InputError);
  EXPECT_NO_THROW((Shape{INT32_MAX}));
  EXPECT_THROW((Shape{65536, 32768}), InputError);
  EXPECT_THROW((Shape{INT64_MAX, INT64_MAX}), InputError);
}

TEST(Shape, HasAsManyAxesAsCaffesAtMost) {
  EXPECT_EQ(Shape(std::vector<int64_t>(32, 1)).rank(), 32U);
  expect_error<InputError>([] { Shape(std::vector<int64_t>(33, 1)); }, {"33 axes", "32"});
}

TEST(Shape, ParsesTexts) {
  EXPECT_EQ(Shape::parse("1x3x107x4000"), (Shape{1, 3, 107, 4000}));
  EXPECT_EQ(Shape::parse("1,3,107,4000"), (Shape{1, 3, 107, 4000}));
  EXPECT_EQ(Shape::parse("7"), Shape{7});
  for (const char* bad :
       {"", "x", "1x", "x1", "1x-3", "1x0", "1,,3", "1,3,", "1x3 ", "a", "99999999999x99999999999"})
    EXPECT_THROW(Shape::parse(bad), UsageError) << bad;
}

}  // namespace
}  // namespace revisit::engine

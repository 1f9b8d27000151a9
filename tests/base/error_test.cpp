#include "revisit/base/error.h"

#include <gtest/gtest.h>

namespace revisit {
namespace {

TEST(NearestName, OffersLikelyMisspellingsOnly) {
  const std::vector<std::string> layers = {"conv1", "conv2", "pool5", "relu3_1"};
  EXPECT_EQ(nearest_name("cov1", layers), "conv1");
  EXPECT_EQ(nearest_name("conv3", layers), "conv1");  // the first of equals
  EXPECT_EQ(nearest_name("relu31", layers), "relu3_1");
  EXPECT_EQ(nearest_name("fullyconnected", layers), "");
  EXPECT_EQ(nearest_name("", {}), "");
}

TEST(NearestName, HugeNamesCostNothing) {
  EXPECT_EQ(nearest_name(std::string(1'000'000, 'x'), {std::string(1'000'000, 'y')}), "");
}

TEST(DidYouMean, IsAHintOrNothing) {
  EXPECT_EQ(did_you_mean("cov1", {"conv1"}), " (did you mean 'conv1'?)");
  EXPECT_EQ(did_you_mean("zzzz", {"conv1"}), "");
}

}  // namespace
}  // namespace revisit

#include "testing.h"

namespace revisit {
namespace {

TEST(Error, MessageIsItsParts) {
  const InputError inner("give it by ", "a.b", ", found ", 7);
  EXPECT_STREQ(inner.what(), "give it by a.b, found 7");
  EXPECT_STREQ(UsageError("a.bin: ", inner, "; ", UsageError("b")).what(),
               "a.bin: give it by a.b, found 7; b");
  EXPECT_STREQ(UsageError(inner).what(), inner.what()) << "also as another type";
}

TEST(NearestName, OffersLikelyMisspellingsOnly) {
  const std::vector<std::string> layers = {"conv1", "conv2", "pool5", "relu3_1"};
  EXPECT_EQ(nearest_name("cov1", layers), "conv1");
  EXPECT_EQ(nearest_name("conv3", layers), "conv1");  // the first of equals
  EXPECT_EQ(nearest_name("relu31", layers), "relu3_1");
  EXPECT_EQ(nearest_name("fullyconnected", layers), "");
  EXPECT_EQ(nearest_name("", {}), "");
  EXPECT_EQ(nearest_name("ocnv1", layers), "conv1") << "neighbors that changed places";
  EXPECT_EQ(nearest_name("C", {"b", "c"}), "c") << "in another case";
  EXPECT_EQ(nearest_name("sl", {"p", "d", "s1"}), "") << "as good as any";
}

TEST(NearestName, HugeNamesCostNothing) {
  EXPECT_EQ(nearest_name(std::string(1'000'000, 'x'), {std::string(1'000'000, 'y')}), "");
}

TEST(DidYouMean, IsAHintOrNothing) {
  EXPECT_EQ(nearest_name_hint("cov1", {"conv1"}), " (did you mean 'conv1'?)");
  EXPECT_EQ(nearest_name_hint("zzzz", {"conv1"}), "");
  EXPECT_EQ(misspelling_hint("lnr_param", {"lrn_param"}, 6), " (did you mean 'lrn_param'?)");
  EXPECT_EQ(misspelling_hint("mil_param", {"mvn_param"}, 6), "") << "but for the common letters";
}

}  // namespace
}  // namespace revisit

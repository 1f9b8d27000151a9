// What the original Caffe computed for us, through the command that people use. golden/nets, which
// takes longest, is in tests/engine/golden_nets_test.cpp.
#include <gtest/gtest.h>

#include <algorithm>

#include "test_data.h"

namespace revisit {
namespace {

class GoldenVerify : public testing::TestWithParam<const char*> {};

TEST_P(GoldenVerify, EveryCaseAgrees) {
  REVISIT_NEED_SHARED(folder, GetParam());
  const auto result = test::run_revisit("net verify --threads 2 " + folder.string());
  EXPECT_EQ(result.exit_code, 0) << result.out << result.err;
}

INSTANTIATE_TEST_SUITE_P(Folders, GoldenVerify,
                         testing::Values("golden/zoo", "golden/formats", "golden/slim",
                                         "data/caffemodels"),
                         [](const auto& instance) {
                           std::string name = instance.param;
                           std::replace(name.begin(), name.end(), '/', '_');
                           return name;
                         });

}  // namespace
}  // namespace revisit

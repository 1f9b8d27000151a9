// References are from the original Caffe. tests/engine/golden_nets_test.cpp tests golden/nets of
// the shared data, which takes longest.
#include <gtest/gtest.h>

#include <algorithm>

#include "test_data.h"

namespace revisit {
namespace {

void expect_all_agree(const std::filesystem::path& folder) {
  const auto result = test::run_revisit("net verify --threads 2 " + folder.string());
  EXPECT_EQ(result.exit_code, 0) << result.out << result.err;
}

TEST(GoldenVerifyProject, EveryCaseAgrees) {
  for (const char* folder : {"zoo", "formats"}) expect_all_agree(test::golden(folder));
}

TEST(GoldenVerifyProject, Bf16ReportsEachLayer) {
  const auto result =
      test::run_revisit("net verify --precision bf16 --layers " + test::golden("formats").string());
  EXPECT_EQ(result.exit_code, 0) << result.out << result.err;
  EXPECT_NE(result.out.find("error\n"), std::string::npos) << result.out;
}

class GoldenVerify : public testing::TestWithParam<const char*> {};

TEST_P(GoldenVerify, EveryCaseAgrees) {
  REVISIT_NEED_SHARED(folder, GetParam());
  expect_all_agree(folder);
}

INSTANTIATE_TEST_SUITE_P(Folders, GoldenVerify, testing::Values("golden/slim", "data/caffemodels"),
                         [](const auto& instance) {
                           std::string name = instance.param;
                           std::replace(name.begin(), name.end(), '/', '_');
                           return name;
                         });

}  // namespace
}  // namespace revisit

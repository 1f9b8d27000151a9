#include "revisit/proto/net_file.h"
#include "testing.h"

namespace revisit::proto {
namespace {

constexpr const char* kNet = R"(
  layer { name: 'in' type: 'Input' top: 'x' input_param { shape { dim: 1 } } }
  layer { name: 'r' type: 'ReLU' bottom: 'x' top: 'y' include { stage: 'rare' } })";

std::vector<std::string> layers(const NetFile& file) {
  std::vector<std::string> names;
  for (const auto& layer : file.net.layer()) names.push_back(layer.name());
  return names;
}

class SolverFile : public testing::Test {
 protected:
  SolverFile() { write_file(dir_ / "nets/net.prototxt", kNet); }
  NetFile read(const std::string& solver) const {
    write_file(dir_ / "solver.prototxt", solver);
    return read_net(dir_ / "solver.prototxt");
  }
  const TempDir dir_;
};

TEST_F(SolverFile, IsFollowedToTheNetBesideIt) {
  const NetFile file = read("net: 'nets/net.prototxt' base_lr: 0.1 solver_mode: CPU");
  EXPECT_EQ(layers(file), std::vector<std::string>{"in"});
  ASSERT_EQ(file.warnings.size(), 1U);
  EXPECT_EQ(file.warnings[0], (dir_ / "solver.prototxt").string() +
                                  ": is a solver file; read the net it names, " +
                                  (dir_ / "nets/net.prototxt").string());
}

TEST_F(SolverFile, EveryFieldThatNamesOneNet) {
  const std::string path = (dir_ / "nets/net.prototxt").string();
  for (const std::string& solver :
       {"net: '" + path + "'", "train_net: '" + path + "'", "test_net: '" + path + "'",
        "train_net: 'elsewhere' test_net: '" + path + "' test_iter: 1",
        "net: '" + path + "' test_net: '" + path + "'"})
    EXPECT_EQ(layers(read(solver)).size(), 1U) << solver;
}

TEST_F(SolverFile, WorkingFolderComesSecond) {
  const fs::path before = fs::current_path();
  fs::current_path(dir_.path());
  write_file(dir_ / "sub/solver.prototxt", "net: 'nets/net.prototxt'");
  EXPECT_EQ(layers(read_net("sub/solver.prototxt")).size(), 1U);
  write_file(dir_ / "sub/nets/net.prototxt", "layer { name: 'beside' }");
  EXPECT_EQ(layers(read_net("sub/solver.prototxt")), std::vector<std::string>{"beside"});
  fs::current_path(before);
}

TEST_F(SolverFile, TestStateChoosesStages) {
  EXPECT_EQ(layers(read("net: 'nets/net.prototxt' test_state { stage: 'rare' }")),
            (std::vector<std::string>{"in", "r"}));
}

TEST_F(SolverFile, RejectsAmbiguousNets) {
  expect_error<InputError>([&] { read("net: 'a' test_net: 'b'"); },
                           {"solver.prototxt: is a solver file", "'a', 'b'"});
  expect_error<InputError>([&] { read("net_param { name: 'n' }"); }, {"with an embedded net"});
  expect_error<InputError>([&] { read("net: 'nets/net.prototxt' test_state { } test_state { }"); },
                           {"several states", "'nets/net.prototxt'"});
  expect_error<InputError>([&] { read("net: 'nowhere.prototxt'"); },
                           {"is a solver file", "'nowhere.prototxt'", "neither in its folder"});
}

TEST_F(SolverFile, ThatNamesASolverIsNotFollowedForEver) {
  expect_error<InputError>([&] { read("net: 'solver.prototxt'"); },
                           {"unknown field 'net' in NetParameter", "is this a solver file?"});
}

TEST_F(SolverFile, NamesUnknownFields) {
  expect_error<InputError>([&] { read("net: 'nets/net.prototxt' fork_option: 3"); },
                           {"unknown field 'net'", "is this a solver file?"});
}

}  // namespace
}  // namespace revisit::proto

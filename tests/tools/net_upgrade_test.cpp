// References are from Caffe's own upgrade tools.
#include <google/protobuf/text_format.h>
#include <google/protobuf/util/message_differencer.h>
#include <sys/stat.h>

#include <future>

#include "caffe_schema.pb.h"
#include "revisit/proto/net_file.h"
#include "revisit/proto/weights_file.h"
#include "testing.h"

namespace revisit {
namespace {

using google::protobuf::util::MessageDifferencer;

class NetUpgrade : public testing::Test {
 protected:
  std::string path(const std::string& name) const { return (dir_ / name).string(); }
  void expect_failure(int code, const std::string& arguments, const std::string& part) const {
    expect_exit(code, {part}, "net upgrade " + arguments);
  }
  const TempDir dir_;
};

caffe::NetParameter text_net(const std::string& text) {
  caffe::NetParameter net;
  EXPECT_TRUE(google::protobuf::TextFormat::ParseFromString(text, &net));
  return net;
}

/// Blobs by layer and index, without layers that have none.
std::map<std::string, std::vector<float>> weights_of(const fs::path& path) {
  std::map<std::string, std::vector<float>> all;
  const auto file = proto::WeightsFile::open(path);
  for (size_t i = 0; i < file->layers().size(); ++i)
    for (const proto::Blob& blob : file->read(i)) {
      std::vector<float>& values = all[file->layers()[i].name];
      values.insert(values.end(), blob.data.begin(), blob.data.end());
    }
  return all;
}

TEST_F(NetUpgrade, NamesOtherFormats) {
  write_file(dir_ / "in.npy", "\x93NUMPY\1");
  expect_failure(3, path("in.npy"),
                 "in.npy: expected a prototxt or weights of Caffe, found a NumPy array");
  ASSERT_EQ(::mkfifo((dir_ / "fifo").c_str(), 0600), 0);
  expect_failure(3, path("fifo"), "fifo: is not a regular file");
}

TEST_F(NetUpgrade, AFifoIsWrittenToAndStaysOne) {
  write_file(dir_ / "in.prototxt",
             "layer { name: 'a' type: 'Input' top: 'a' input_param { shape { dim: 1 } } }");
  ASSERT_EQ(::mkfifo((dir_ / "fifo").c_str(), 0600), 0);
  for (const std::string& out : {path("fifo") + " --force", path("fifo")}) {
    auto reader = std::async(std::launch::async, [&] {
      return std::system(("timeout 60 cat " + path("fifo") + " > " + path("copy")).c_str());
    });
    run_ok("net upgrade " + path("in.prototxt") + " " + out);
    EXPECT_EQ(reader.get(), 0);
    EXPECT_TRUE(read_file(dir_ / "copy").starts_with("layer {"));
  }
  EXPECT_TRUE(fs::is_fifo(dir_ / "fifo"));
  expect_failure(2, path("in.prototxt") + " " + path("in.prototxt"), "give --force to replace it");
  expect_failure(2, path("in.prototxt") + " --force " + dir_.path().string(), "is a folder");
}

void expect_same(const caffe::NetParameter& ours, const caffe::NetParameter& wanted) {
  MessageDifferencer differencer;
  std::string difference;
  differencer.ReportDifferencesToString(&difference);
  EXPECT_TRUE(differencer.Compare(wanted, ours)) << difference.substr(0, 2000);
}

TEST_F(NetUpgrade, EqualsTheOriginal) {
  const std::filesystem::path folder = test::golden("formats");
  for (const std::string name : {"mini_v0", "mini_v1"}) {
    SCOPED_TRACE(name);
    const std::string in = (folder / (name + ".prototxt")).string();
    run_ok("net upgrade " + in + " " + path(name));
    expect_same(text_net(read_file(dir_ / name)),
                text_net(read_file(folder / (name + "_upgraded_by_caffe.prototxt"))));
    EXPECT_EQ(run_revisit("net upgrade " + in).out, read_file(dir_ / name));
    run_ok("net upgrade " + (folder / (name + ".caffemodel")).string() + " --force " + path(name));
    caffe::NetParameter ours, wanted;
    ASSERT_TRUE(ours.ParseFromString(read_file(dir_ / name)));
    ASSERT_TRUE(
        wanted.ParseFromString(read_file(folder / (name + "_upgraded_by_caffe.caffemodel"))));
    expect_same(ours, wanted);
  }
}

TEST_F(NetUpgrade, EveryWeightsFileReadsTheSameAfterwards) {
  const std::filesystem::path folder = test::golden("formats");
  const auto truth = weights_of(folder / "mini_v2.caffemodel");
  int n_files = 0;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string name = entry.path().filename().string();
    if (name.find(".caffemodel") == std::string::npos) continue;
    SCOPED_TRACE(name);
    run_ok("net upgrade " + entry.path().string() + " " + path(name));
    caffe::NetParameter net;
    ASSERT_TRUE(net.ParseFromString(read_file(dir_ / name)));
    EXPECT_EQ(net.layers_size(), 0);
    EXPECT_EQ(weights_of(dir_ / name), truth);
    ++n_files;
  }
  EXPECT_GE(n_files, 12);
}

TEST_F(NetUpgrade, TrainingLayersStay) {
  write_file(dir_ / "train.prototxt",
             "layers { name: 'd' type: DATA top: 'x' data_param { batch_size: 2 crop_size: 3 "
             "} include { phase: TRAIN } }"
             "layers { name: 'l' type: SOFTMAX_LOSS bottom: 'x' bottom: 'y' }");
  const auto result = run_ok("net upgrade " + path("train.prototxt"));
  expect_same(
      text_net(result.out),
      text_net("layer { name: 'd' type: 'Data' top: 'x' include { phase: TRAIN } data_param { "
               "batch_size: 2 } transform_param { crop_size: 3 } }"
               "layer { name: 'l' type: 'SoftmaxWithLoss' bottom: 'x' bottom: 'y' }"));
  EXPECT_EQ(result.err, "");
}

TEST_F(NetUpgrade, TrainingLayersGoWhenInferenceIsAskedFor) {
  write_file(dir_ / "train.prototxt",
             "layers { name: 'd' type: DATA top: 'x' top: 'y' data_param { batch_size: 2 } "
             "transform_param { crop_size: 3 } }"
             "layers { name: 'l' type: SOFTMAX_LOSS bottom: 'x' bottom: 'y' top: 'l' }");
  const auto result = run_ok("net upgrade --inference " + path("train.prototxt"));
  expect_same(
      text_net(result.out),
      text_net("layer { name: 'd' type: 'Input' top: 'x' input_param { shape { dim: 2 dim: 3 dim: "
               "3 dim: 3 } } } layer { name: 'prob' type: 'Softmax' bottom: 'x' top: 'prob' }"));
  EXPECT_HAS(result.err, "is now the input");

  expect_failure(
      2, "--inference " + test::golden("formats").string() + "/mini_v1.caffemodel " + path("out"),
      "--inference");
}

TEST_F(NetUpgrade, InferenceTakesShapesOfInputs) {
  const std::string data =
      "layer { name: 'd' type: 'Data' top: 'data' top: 'label' data_param { batch_size: 1 } }";
  const std::string rest =
      "layer { name: 'ip' type: 'InnerProduct' bottom: 'data' top: 'ip' inner_product_param { "
      "num_output: 2 } }";
  write_file(dir_ / "train", data + rest);
  const auto shaped = [&](const std::string& options, const std::string& file) {
    return run_revisit("net upgrade --inference " + options + " " + path(file) + " --force " +
                       path("out"));
  };
  for (const char* shape : {"1,3,4,5", "data=1x3x4x5"}) {
    EXPECT_EQ(shaped(std::string("--input-shape ") + shape, "train").exit_code, 0);
    expect_same(
        text_net(read_file(dir_ / "out")),
        text_net("layer { name: 'd' type: 'Input' top: 'data' input_param { shape { dim: 1 dim: 3 "
                 "dim: 4 dim: 5 } } }" +
                 rest));
    run_ok("net inspect " + path("out"));
  }
  // One layer with two tops tells the shapes of both or of none.
  const std::string sum = "layer { name: 's' type: 'Eltwise' bottom: 'a' bottom: 'b' top: 's' }";
  write_file(dir_ / "two", "input: 'a' input: 'b' " + sum);
  EXPECT_EQ(shaped("--input-shape a=2 --input-shape b=3", "two").exit_code, 0);
  expect_same(
      text_net(read_file(dir_ / "out")),
      text_net("layer { name: 'input' type: 'Input' top: 'a' top: 'b' input_param { shape { dim: 2 "
               "} shape { dim: 3 } } }" +
               sum));
  write_file(dir_ / "same",
             "layer { name: 'i' type: 'Input' top: 'a' top: 'b' input_param { shape { dim: 7 "
             "} } }" +
                 sum);
  EXPECT_EQ(shaped("--input-shape b=3", "same").exit_code, 0);
  EXPECT_EQ(text_net(read_file(dir_ / "out")).layer(0).input_param().DebugString(),
            "shape {\n  dim: 7\n}\nshape {\n  dim: 3\n}\n");

  const auto refused = [&](const std::string& options, const std::string& part) {
    expect_failure(2, options, part);
  };
  refused("--inference --input-shape a=2 " + path("two"), "the input 'b' has no shape either");
  refused("--inference --input-shape 2 " + path("two"), "has 2 inputs; say which one");
  refused("--inference --input-shape c=2 " + path("two"), "has no input 'c'");
  refused("--inference --input-shape 1,,2 " + path("train"), "expected a shape like");
  refused("--input-shape 1,3,4,5 " + path("train"), "--input-shape: needs --inference");
}

TEST_F(NetUpgrade, OverwritesOnlyWhenForced) {
  write_file(dir_ / "in", "layers { name: 'r' type: RELU bottom: 'x' top: 'x' }");
  write_file(dir_ / "out", "mine");
  expect_failure(2, path("in") + " " + path("out"), "--force");
  EXPECT_EQ(read_file(dir_ / "out"), "mine");
  run_ok("net upgrade --force " + path("in") + " " + path("out"));
  EXPECT_EQ(text_net(read_file(dir_ / "out")).layer(0).type(), "ReLU");
  // Replacement in place: the file is complete before it takes the old one's name.
  run_ok("net upgrade --force " + path("in") + " " + path("in"));
  EXPECT_EQ(read_file(dir_ / "in"), read_file(dir_ / "out"));
}

TEST_F(NetUpgrade, NamesBadFiles) {
  expect_failure(3, path("none") + " " + path("o"), "none: cannot open");
  write_file(dir_ / "text", "layer {\n  nme: 'x'\n}");
  expect_failure(3, path("text"), "text:2:3: unknown field 'nme'");
  expect_failure(3, "--allow unknown " + path("text"), "did you mean 'name'?");
  write_file(dir_ / "fork", "layer { name: 'x' dense_crf_param { } }");
  run_ok("net upgrade --allow unknown " + path("fork"));
  write_file(dir_ / "binary", std::string("\x01\x02\x00\x03", 4));
  expect_failure(3, path("binary") + " " + path("o"), "not a caffemodel");
  expect_failure(2, path("binary"), "missing argument OUT");
  write_file(dir_ / "h5", "\x89HDF\r\n\x1a\n");
  expect_failure(3, path("h5") + " " + path("o"), "corrupt HDF5 file");
  expect_failure(2, "--limit text=0 " + path("text"), "--limit text: expected 1 to");
  EXPECT_FALSE(fs::exists(dir_ / "o"));
}

}  // namespace
}  // namespace revisit

// Reference: outputs of the original Caffe (tests/golden/formats).
#include <google/protobuf/struct.pb.h>
#include <google/protobuf/util/json_util.h>

#include "caffe_schema.pb.h"
#include "revisit/engine/net.h"
#include "revisit/proto/net_file.h"
#include "revisit/proto/npy.h"
#include "testing.h"

namespace revisit::engine {
namespace {

constexpr double kTolerance = 1e-5;  // tests/golden/README.md: GEMM, fail above

TEST(Formats, EveryPairOfFilesGivesTheSame) {
  const std::filesystem::path folder = test::golden("formats");
  google::protobuf::Value index;
  ASSERT_TRUE(
      google::protobuf::util::JsonStringToMessage(read_file(folder / "index.json"), &index).ok());
  const proto::Blob in = proto::read_npy(folder / "in_data.npy");
  // The layer that writes each blob last.
  const std::map<std::string, std::string> outputs = {
      {"conv1", "relu1"}, {"pool1", "pool1"}, {"norm1", "norm1"}, {"conv2", "relu2"},
      {"pool2", "pool2"}, {"fc3", "drop3"},   {"fc4", "fc4"},     {"prob", "prob"}};
  int pairs = 0;
  for (const auto& entry : index.list_value().values()) {
    const auto& pair = entry.struct_value().fields();
    ASSERT_TRUE(pair.at("caffe_accepts").bool_value());
    const std::string prototxt = pair.at("prototxt").string_value();
    const std::string weights = pair.at("weights").string_value();
    SCOPED_TRACE(prototxt + " with " + weights);
    engine::Run run(Net::load(folder / prototxt, folder / weights).plan({}, {.keep_all = true}));
    std::copy(in.data.begin(), in.data.end(), run.input("data").data);
    run.forward();
    for (const auto& [blob, layer] : outputs) {
      const proto::Blob wanted = proto::read_npy(folder / ("out_" + blob + ".npy"));
      EXPECT_EQ(run.layer_output(layer).shape, Shape(wanted.shape)) << blob;
      EXPECT_LE(relative_error(run.layer_output(layer).values(), wanted.data), kTolerance) << blob;
    }
    engine::Run from_memory(
        Net::load_from_memory(read_file(folder / prototxt), read_file(folder / weights))
            .plan({}, {.keep_all = true}));
    std::copy(in.data.begin(), in.data.end(), from_memory.input("data").data);
    from_memory.forward();
    EXPECT_TRUE(
        std::ranges::equal(from_memory.output("prob").values(), run.output("prob").values()))
        << "files in memory";
    ++pairs;
  }
  EXPECT_EQ(pairs, 22);
}

TEST(Formats, FilesInMemoryHaveNamesInErrors) {
  const std::filesystem::path folder = test::golden("formats");
  const std::string prototxt = read_file(folder / "mini_v2.prototxt");
  const std::string weights = read_file(folder / "mini_v2.caffemodel");
  for (const std::string& half :
       {weights.substr(0, weights.size() / 2),
        read_file(folder / "mini.caffemodel.h5").substr(0, 5000), std::string()})
    expect_error<InputError>([&] { Net::load_from_memory(prototxt, half); }, {"<weights>: "});
  expect_error<InputError>([&] { Net::load_from_memory(prototxt + "}", weights); },
                           {"<prototxt>:", ": "});
  expect_error<InputError>([&] { Net::load_from_memory("", weights); }, {"<prototxt>: is empty"});
}

class TrainingNet : public testing::Test {
 protected:
  fs::path net(const std::string& text) const {
    write_file(dir_ / "net.prototxt", text);
    return dir_ / "net.prototxt";
  }
  const TempDir dir_;
};

const std::string kTrainVal = R"(
  layer { name: "mnist" type: "Data" top: "data" top: "label" include { phase: TRAIN }
          data_param { batch_size: 64 } }
  layer { name: "mnist" type: "Data" top: "data" top: "label" include { phase: TEST }
          data_param { batch_size: 100 } }
  layer { name: "ip" type: "InnerProduct" bottom: "data" top: "ip"
          inner_product_param { num_output: 10 } }
  layer { name: "accuracy" type: "Accuracy" bottom: "ip" bottom: "label" top: "accuracy"
          include { phase: TEST } }
  layer { name: "loss" type: "SoftmaxWithLoss" bottom: "ip" bottom: "label" top: "loss" })";

TEST_F(TrainingNet, RunsAsItsDeployNetWould) {
  const Net loaded =
      Net::load_with_random_weights(net(kTrainVal), 1, {.inputs = {{"data", {2, 1, 28, 28}}}});
  EXPECT_EQ(loaded.outputs(), std::vector<std::string>{"prob"});
  EXPECT_EQ(loaded.plan().outputs()[0].shape, (Shape{2, 10}));
  EXPECT_EQ(loaded.warnings().size(), 3U);
}

TEST_F(TrainingNet, AsksForAShapeItDoesNotSay) {
  expect_error<InputError>(
      [&] { Net::load_without_weights(net(kTrainVal)); },
      {"layer 'mnist' (Input)", "no shape for the input 'data'", "an input shape"});
}

void write_weights(const fs::path& file, const std::vector<std::string>& layers) {
  caffe::NetParameter net;
  for (const std::string& name : layers) {
    caffe::LayerParameter& layer = *net.add_layer();
    layer.set_name(name);
    caffe::BlobProto& blob = *layer.add_blobs();
    blob.mutable_shape()->add_dim(1);
    blob.mutable_shape()->add_dim(1);
    blob.add_data(3);
  }
  proto::write_net_binary(file, net);
}

TEST_F(TrainingNet, BranchesThatShareWeights) {
  const std::string fc =
      " type: 'InnerProduct' param { name: 'w' } inner_product_param { num_output: 1 bias_term: "
      "false } ";
  const fs::path prototxt =
      net("input: 'x' input_shape { dim: 1 dim: 1 }"
          "layer { name: 'a' bottom: 'x' top: 'a'" +
          fc + "}" + "layer { name: 'b' bottom: 'x' top: 'b'" + fc + "}");
  // One of them is enough, whichever it is, and whether or not it is run.
  for (const std::vector<std::string>& held : std::vector<std::vector<std::string>>{{"a"}, {"b"}}) {
    write_weights(dir_ / "w", held);
    for (const std::string end : {"", "a", "b"}) {
      engine::Run run(Net::load(prototxt, dir_ / "w", {.end = end}).plan({}, {.keep_all = true}));
      run.input("x").data[0] = 2;
      run.forward();
      for (const std::string name : {"a", "b"})
        if (end.empty() || end == name) {
          EXPECT_EQ(run.output(name).values()[0], 6) << name;
        }
    }
  }
  write_weights(dir_ / "w", {"other"});
  expect_error<InputError>([&] { Net::load(prototxt, dir_ / "w"); }, {"no weights", "a, b"});
}

}  // namespace
}  // namespace revisit::engine

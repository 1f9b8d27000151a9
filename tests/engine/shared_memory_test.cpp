// Blobs in shared memory in Caffe, modified in place: all of them must change.
#include "net_case.h"
#include "testing.h"

namespace revisit::engine {
namespace {

using Numbers = std::vector<float>;

std::map<std::string, Numbers> outputs_of(const Net& net, const Numbers& input,
                                          const PlanOptions& options = {}) {
  engine::Run run(net.plan({}, options));
  std::copy(input.begin(), input.end(), run.input("data").data);
  run.forward();
  std::map<std::string, Numbers> outputs;
  for (const Port& port : run.plan().outputs()) {
    const auto values = run.output(port.name).values();
    outputs[port.name] = {values.begin(), values.end()};
  }
  return outputs;
}

const std::string kX = layer("x", "Power", {"data"}),
                  kSplit = "layer { name: 's' type: 'Split' bottom: 'x' top: 'a' top: 'b' } ",
                  kReluOnA = in_place("r", "ReLU", "a");

std::map<std::string, Numbers> outputs_of(const std::string& layers) {
  return outputs_of(small_net({1, 4}, layers), {-1, 2, -3, 4});
}

TEST(SharedMemory, IsReadAfterALayerInPlace) {
  // Caffe's results.
  EXPECT_EQ(outputs_of(kX + kSplit + kReluOnA + layer("sum", "Eltwise", {"a", "b"})).at("sum"),
            (Numbers{0, 4, 0, 8}));
  for (const char* const type : {"Flatten", "Reshape", "Squeeze", "Concat", "Slice", "Permute"}) {
    const std::string param =
        type == std::string("Reshape") ? "reshape_param { shape { dim: 2 dim: 2 } }" : "";
    EXPECT_EQ(outputs_of(kX + layer("a", type, {"x"}, param) + kReluOnA +
                         layer("y", "Power", {"x"}, "power_param { shift: 1 }"))
                  .at("y"),
              (Numbers{1, 3, 1, 5}))
        << type;
  }
}

TEST(SharedMemory, OfAnOutputIsOverwrittenByLaterLayers) {
  const auto outputs = outputs_of(kX + kSplit + kReluOnA);
  EXPECT_EQ(outputs.size(), 2U);
  EXPECT_EQ(outputs.at("a"), (Numbers{0, 2, 0, 4}));
  EXPECT_EQ(outputs.at("b"), (Numbers{0, 2, 0, 4}));
}

TEST(SharedMemory, IsReadAsItWasBefore) {
  EXPECT_EQ(outputs_of(kX + kSplit + layer("y", "Power", {"b"}) + kReluOnA).at("y"),
            (Numbers{-1, 2, -3, 4}));
}

TEST(SharedMemory, IsNotThatOfCopies) {
  for (const std::string& copies :
       {layer("a", "Concat", {"x", "data"}, "concat_param { axis: 0 }"),
        layer("a", "Permute", {"x"}, "permute_param { order: 1 order: 0 }"),
        std::string("layer { name: 'a' type: 'Slice' bottom: 'x' top: 'a' top: 'c' } "),
        layer("a", "Dropout", {"x"})})
    EXPECT_EQ(outputs_of(kX + copies + kReluOnA + layer("y", "Power", {"x"})).at("y"),
              (Numbers{-1, 2, -3, 4}))
        << copies;
}

TEST(SharedMemory, IsNotForTheOtherInputOfALayerInPlace) {
  expect_error<InputError>(
      [] {
        outputs_of(kX + kSplit +
                   "layer { name: 'm' type: 'Scale' bottom: 'a' bottom: 'b' top: 'a' "
                   "scale_param { axis: 0 } }");
      },
      {"'m' (Scale)", "in place on 'a'", "shares the memory"});
}

TEST(SharedMemory, OfALayerIsGraftedOntoAsALaterLayerLeavesIt) {
  const std::string read = layer("p", "Power", {"x"}, "power_param { shift: 1 }"),
                    elsewhere = layer("p", "Power", {"data"}, "power_param { shift: 1 }"),
                    flat = layer("a", "Flatten", {"x"});
  for (const std::string& layers :
       {kX + flat + kReluOnA + read, kX + kSplit + kReluOnA + read,
        kX + flat + kReluOnA + elsewhere, kX + kSplit + kReluOnA + elsewhere}) {
    const Net net = small_net({1, 2, 2, 1}, layers, "x+p");
    EXPECT_EQ(outputs_of(net, {-1, 2, -3, 4}).at("x+p"), (Numbers{1, 3, 1, 5})) << layers;
    EXPECT_EQ(net.plan().outputs()[0].shape, (Shape{1, 2, 2, 1}));
  }
  // In-place layers before the sharing layer are already included.
  EXPECT_EQ(outputs_of(small_net({1, 4},
                                 kX + kSplit + kReluOnA + layer("c", "Flatten", {"b"}) +
                                     layer("p", "Power", {"c"}, "power_param { shift: 1 }"),
                                 "c+p"),
                       {-1, 2, -3, 4})
                .at("c+p"),
            (Numbers{1, 3, 1, 5}));
}

TEST(SharedMemory, LayersThatShowItAreNotOfTheFile) {
  const Net net = small_net(
      {1, 2, 2, 1}, kX + layer("a", "Flatten", {"x"}) + kReluOnA + layer("y", "Power", {"x"}));
  EXPECT_EQ(net.layer_names(), (std::vector<std::string>{"data", "x", "a", "r", "y"}));
  const Plan plan = net.plan();
  ASSERT_EQ(plan.layers().size(), 6U);
  EXPECT_EQ(plan.layers()[4].name, "x after r");
  EXPECT_EQ(plan.layers()[4].outputs[0], (Shape{1, 2, 2, 1}));
}

/// Generates random nets with shared memory and evaluates them like Caffe, in shared memory.
class Maker {
 public:
  explicit Maker(unsigned seed) : random_(seed) {
    for (int i = 0; i < 8; ++i) input.push_back(static_cast<float>(one_of(9)) - 4);
    blobs_["data"] = std::make_shared<Numbers>(input);
    for (int i = 0; i < 14; ++i) add("l" + std::to_string(i));
  }

  Numbers input;
  std::string text;

  /// Blobs that no layer reads, by name.
  std::map<std::string, Numbers> outputs() const {
    std::map<std::string, Numbers> result;
    for (const auto& [name, numbers] : blobs_)
      if (!read_.count(name)) result[name] = *numbers;
    return result;
  }

 private:
  int one_of(int n) { return std::uniform_int_distribution<int>(0, n - 1)(random_); }

  std::string pick() {
    return std::next(blobs_.begin(), one_of(static_cast<int>(blobs_.size())))->first;
  }

  void add(const std::string& name) {
    const std::string from = pick();
    const auto numbers = blobs_.at(from);
    const bool was_read = read_.count(from) > 0;
    read_.insert(from);
    switch (one_of(6)) {
      case 0:
        text += "layer { name: '" + name + "' type: 'Split' bottom: '" + from + "' top: '" + name +
                "' top: '" + name + "b' } ";
        blobs_[name] = blobs_[name + "b"] = numbers;
        return;
      case 1: {
        static const std::vector<std::string> kTypes{"Flatten", "Concat", "Slice"};
        text += layer(name, kTypes[one_of(3)], {from});
        blobs_[name] = numbers;
        return;
      }
      case 2: {
        static const std::vector<std::string> kShapes{"dim: 1 dim: 8", "dim: 2 dim: 4",
                                                      "dim: 1 dim: 2 dim: 2 dim: 2"};
        text += layer(name, "Reshape", {from},
                      "reshape_param { shape { " + kShapes[one_of(3)] + " } }");
        blobs_[name] = numbers;
        return;
      }
      default:
        break;
    }
    const bool halves = one_of(2) == 1;
    const auto compute = [&](float x) { return halves ? 0.5F * x - 1 : std::max(x, 0.0F); };
    const std::string type = halves ? "Power" : "ReLU",
                      param = halves ? "power_param { scale: 0.5 shift: -1 }" : "";
    if (was_read) {  // Caffe then rejects in-place layers
      text += layer(name, type, {from}, param);
      blobs_[name] = std::make_shared<Numbers>(*numbers);
      for (float& x : *blobs_[name]) x = compute(x);
    } else {
      text += in_place(name, type, from, param);
      for (float& x : *numbers) x = compute(x);
      read_.erase(from);
    }
  }

  std::mt19937 random_;
  std::map<std::string, std::shared_ptr<Numbers>> blobs_;
  std::set<std::string> read_;
};

TEST(SharedMemory, OfRandomNetsIsThatOfTheOriginal) {
  for (unsigned seed = 0; seed < 300; ++seed) {
    const Maker made(seed);
    const Net net = small_net({1, 2, 4, 1}, made.text);
    for (const PlanOptions& options :
         {PlanOptions{}, {.keep_all = true}, {.reference_kernels = true}})
      ASSERT_EQ(outputs_of(net, made.input, options), made.outputs()) << seed << "\n" << made.text;
  }
}

}  // namespace
}  // namespace revisit::engine

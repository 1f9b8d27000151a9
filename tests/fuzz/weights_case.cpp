#include "weights_case.h"

#include "revisit/engine/net.h"
#include "revisit/proto/weights_file.h"

namespace revisit::fuzz {
namespace {

constexpr const char* kNet = R"(
layer { name: "data" type: "Input" top: "data"
        input_param { shape { dim: 1 dim: 2 dim: 1 dim: 1 } } }
layer { name: "conv1" type: "Convolution" bottom: "data" top: "conv1"
        convolution_param { num_output: 2 kernel_size: 1 } }
layer { name: "fc3" type: "InnerProduct" bottom: "conv1" top: "fc3"
        inner_product_param { num_output: 3 } }
)";

}  // namespace

void read_weights(const std::string& bytes) {
  const InputFile file(bytes);
  works_or_refuses([&] {
    const auto weights = proto::WeightsFile::open(file.path());
    for (size_t i = 0; i < weights->layers().size(); ++i)
      works_or_refuses([&] {
        const size_t n_blobs = weights->read(i).size();
        require(n_blobs == weights->layers()[i].n_blobs, "as many blobs as the index says");
      });
  });
  works_or_refuses([&] {
    static const InputFile prototxt(kNet);
    engine::Net::load(prototxt.path(), file.path(), {.allow_missing = true});
  });
}

}  // namespace revisit::fuzz

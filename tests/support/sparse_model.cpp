#include "sparse_model.h"

#include <gtest/gtest.h>

#include <fstream>

#include "wire_bytes.h"

namespace revisit::test {
namespace {

uint64_t product(const std::vector<uint64_t>& shape) {
  uint64_t count = 1;
  for (const uint64_t size : shape) count *= size;
  return count;
}

/// The tag and length that come before the zeros of a blob's data, shape included.
std::string blob_start(const std::vector<uint64_t>& dims) {
  const uint64_t bytes = 4 * product(dims);
  const std::string start = shape(dims) + tag(5, 2) + varint(bytes);
  return tag(7, 2) + varint(start.size() + bytes) + start;
}

}  // namespace

void write_sparse_alexnet(const std::filesystem::path& file) {
  struct Layer {
    const char* name;
    const char* type;
    std::vector<uint64_t> weights;
  };
  const Layer layers[] = {
      {"conv1", "Convolution", {96, 3, 11, 11}},  {"conv2", "Convolution", {256, 48, 5, 5}},
      {"conv3", "Convolution", {384, 256, 3, 3}}, {"conv4", "Convolution", {384, 192, 3, 3}},
      {"conv5", "Convolution", {256, 192, 3, 3}}, {"fc6", "InnerProduct", {4096, 9216}},
      {"fc7", "InnerProduct", {4096, 4096}},      {"fc8", "InnerProduct", {1000, 4096}}};
  std::ofstream out(file, std::ios::binary);
  const auto zeros = [&](uint64_t count) {
    out.seekp(static_cast<std::streamoff>(4 * count), std::ios::cur);
  };
  out << bytes_field(1, "AlexNet");
  for (const Layer& layer : layers) {
    const std::vector<uint64_t> bias = {layer.weights[0]};
    const std::string head = bytes_field(1, layer.name) + bytes_field(2, layer.type);
    const std::string weights = blob_start(layer.weights), biases = blob_start(bias);
    const uint64_t floats = product(layer.weights) + bias[0];
    out << tag(100, 2) << varint(head.size() + weights.size() + biases.size() + 4 * floats) << head
        << weights;
    zeros(product(layer.weights));
    out << biases;
    zeros(bias[0]);
  }
  const auto size = static_cast<uint64_t>(out.tellp());
  out.close();
  std::filesystem::resize_file(file, size);
  if (!out) ADD_FAILURE() << "cannot write " << file;
}

}  // namespace revisit::test

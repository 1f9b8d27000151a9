#include "problems.h"

#include <gtest/gtest.h>

#include <fstream>
#include <sstream>

#include "caffe_schema.pb.h"
#include "layers/pooling_window.h"

namespace revisit::test {
namespace {

/// `read(fields, problem)` parses the fields after the name.
template <class Problem, class Read>
std::vector<Named<Problem>> problems_of(const char* path, const Read& read) {
  std::ifstream file(path);
  std::vector<Named<Problem>> problems;
  for (std::string line; std::getline(file, line);) {
    if (line.empty() || line[0] == '#') continue;
    std::istringstream fields(line);
    Named<Problem> named;
    fields >> named.name;
    read(fields, named.problem);
    if (!fields) ADD_FAILURE() << path << ": malformed problem: " << line;
    problems.push_back(std::move(named));
  }
  if (problems.empty()) ADD_FAILURE() << path << ": no problems found";
  return problems;
}

}  // namespace

std::vector<NamedConvolution> convolution_problems(MapSize size) {
  auto problems = problems_of<engine::ConvolutionProblem>(
      REVISIT_PROBLEMS "/convolution.txt",
      [size](std::istream& fields, engine::ConvolutionProblem& p) {
        int64_t h = 1, w = 1;  // as in the network
        fields >> p.n >> p.c_in >> p.h >> p.w >> p.c_out >> p.kernel_h >> p.kernel_w >>
            p.stride_h >> p.stride_w >> p.pad_h >> p.pad_w >> p.dilation_h >> p.dilation_w >>
            p.group >> h >> w;
        if (size == MapSize::kFull) p.h = h, p.w = w;
        p.out_h = (p.h + 2 * p.pad_h - p.dilation_h * (p.kernel_h - 1) - 1) / p.stride_h + 1;
        p.out_w = (p.w + 2 * p.pad_w - p.dilation_w * (p.kernel_w - 1) - 1) / p.stride_w + 1;
      });
#if defined(__SANITIZE_ADDRESS__) || \
    defined(__SANITIZE_THREAD__)  // larger ones take minutes and read and write as these do
  std::erase_if(problems, [](const auto& named) { return named.problem.macs() > 8'000'000; });
#endif
  return problems;
}

std::vector<Named<BlockedPooling>> pooling_problems() {
  return problems_of<BlockedPooling>(
      REVISIT_PROBLEMS "/pooling.txt", [](std::istream& fields, BlockedPooling& p) {
        int64_t h = 1, w = 1;
        uint32_t window[6] = {};
        fields >> p.n >> p.c >> h >> w;
        for (uint32_t& value : window) fields >> value;
        caffe::PoolingParameter param;
        param.set_kernel_h(window[0]), param.set_kernel_w(window[1]);
        param.set_stride_h(window[2]), param.set_stride_w(window[3]);
        param.set_pad_h(window[4]), param.set_pad_w(window[5]);
        p.window = engine::PoolingWindow(param).problem({p.n, p.c, h, w});
      });
}

std::vector<Named<engine::LrnProblem>> lrn_problems() {
  return problems_of<engine::LrnProblem>(
      REVISIT_PROBLEMS "/lrn.txt", [](std::istream& fields, engine::LrnProblem& p) {
        fields >> p.n >> p.c >> p.h >> p.w >> p.size >> p.alpha >> p.beta >> p.k;
      });
}

std::vector<Named<engine::InnerProductProblem>> inner_product_problems() {
  return problems_of<engine::InnerProductProblem>(
      REVISIT_PROBLEMS "/inner_product.txt",
      [](std::istream& fields, engine::InnerProductProblem& p) {
        fields >> p.m >> p.n >> p.k >> p.transposed;
      });
}

engine::ConvolutionNdProblem over_axes(const engine::ConvolutionProblem& p) {
  engine::ConvolutionNdProblem result{p.n, p.c_in, p.c_out, p.group, {}, p.threads};
  result.axes = {{p.h, p.out_h, p.kernel_h, p.stride_h, p.pad_h, p.dilation_h},
                 {p.w, p.out_w, p.kernel_w, p.stride_w, p.pad_w, p.dilation_w}};
  return result;
}

}  // namespace revisit::test

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <thread>

#include "caffe_schema.pb.h"
#include "cli/built_in.h"
#include "cli/command.h"
#include "cli/geometry_options.h"
#include "commands/doctor_data.h"
#include "loops/recording.h"
#include "models/cache.h"
#include "models/fetch.h"
#include "revisit/base/error.h"
#include "revisit/base/hash.h"
#include "revisit/engine/machine.h"
#include "revisit/engine/net.h"
#include "revisit/recognition/optional_library.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

std::vector<float> output_of(const engine::Net& net, bool reference_kernels) {
  const engine::Shape input{1, 3, 67, 131};  // small, and no multiple of any block size
  engine::Run run(net.plan({{"data", input}}, {.reference_kernels = reference_kernels}));
  size_t i = 0;
  for (float& value : run.input("data").values()) value = static_cast<float>(i++ * 37 % 256) - 128;
  run.forward();
  const auto output = run.output(net.outputs().at(0)).values();
  return {output.begin(), output.end()};
}

/// AlexNet's layers to conv3 and pool5, with weights in [-1, 1).
engine::Net test_net() {
  const std::string prototxt = models::own_net("alexnet");
  caffe::NetParameter weights;
  const auto add = [&](const char* layer, std::initializer_list<int64_t> shape) {
    caffe::LayerParameter& out = *weights.add_layer();
    out.set_name(layer);
    for (const auto& dims : {std::vector(shape), {*shape.begin()}}) {  // weights, bias
      caffe::BlobProto& blob = *out.add_blobs();
      blob.mutable_shape()->mutable_dim()->Add(dims.begin(), dims.end());
      for (int64_t i = 0; i < engine::Shape(dims).elements(); ++i)
        blob.add_data(static_cast<float>(2 * unit_number(1, static_cast<uint64_t>(i)) - 1));
    }
  };
  add("conv1", {96, 3, 11, 11});
  add("conv2", {256, 48, 5, 5});
  add("conv3", {384, 256, 3, 3});
  return engine::Net::load_from_memory(prototxt, weights.SerializeAsString(),
                                       {.end = "conv3", .graft = "pool5"});
}

/// max|fast - reference| / max|reference|, or NaN if an output is NaN.
double deviation_from_reference() {
  const engine::Net net = test_net();
  const std::vector<float> fast = output_of(net, false), reference = output_of(net, true);
  double difference = 0, largest = 0;
  for (size_t i = 0; i < reference.size(); ++i) {
    const double error = std::abs(double{fast.at(i)} - double{reference[i]});
    if (std::isnan(error)) return error;
    difference = std::max(difference, error);
    largest = std::max(largest, std::abs(double{reference[i]}));
  }
  return difference / largest;
}

bool self_test() {
  constexpr double kTolerance = 1e-4;
  try {
    const double deviation = deviation_from_reference();
    const bool good = deviation <= kTolerance;
    print_finding(
        "self-test", str("AlexNet's first layers, fast kernels against the reference: ", deviation),
        good ? "" : "networks compute wrong results on this machine; please report this output");
    return good;
  } catch (const std::exception& error) {
    print_finding("self-test", error.what(), "networks do not run here; please report this output");
    return false;
  }
}

bool print_program() {
  std::cout << "program\n";
  print_finding("revisit", REVISIT_VERSION);
#ifdef __OPTIMIZE__
  print_finding("build", str("g++ ", __VERSION__, ", optimized"));
#else
  print_finding("build", str("g++ ", __VERSION__, ", not optimized"),
                "many times slower; build with 'cmake --preset release'");
#endif
  for (const OptionalLibrary& library : optional_libraries())
    print_finding(std::string(library.name),
                  str(library.built_in ? "built in: " : "not built in: ", library.use),
                  library.built_in ? "" : how_to_complete());
  return self_test();
}

/// Value of a line "key : value", or "".
std::string value_in(const char* file, const std::string& key) {
  std::ifstream in(file);
  for (std::string line; std::getline(in, line);) {
    const size_t colon = line.find(':');
    if (colon == std::string::npos || !line.starts_with(key)) continue;
    const size_t begin = line.find_first_not_of(" \t", colon + 1);
    return begin == std::string::npos ? "" : line.substr(begin);
  }
  return "";
}

void print_blas() {
  const char* const forced = std::getenv("OPENBLAS_CORETYPE");  // by the user, or by main.cpp
  const std::string faster = engine::faster_blas_core();
  const char* const remedy = forced ? "unset OPENBLAS_CORETYPE" : "export OPENBLAS_CORETYPE=";
  print_finding("OpenBLAS",
                str("kernels for ", engine::blas_core(),
                    forced ? str(", by OPENBLAS_CORETYPE=", forced) : ""),
                faster.empty()
                    ? ""
                    : str("this CPU supports the kernels for ", faster,
                          ", which are several times faster; ", remedy, forced ? "" : faster));
  if (const char* size = std::getenv("OPENBLAS_L2_SIZE"))
    print_finding("OPENBLAS_L2_SIZE", size,
                  "unset it, because it overrides the detected cache size");
}

void print_machine() {
  std::cout << "\nmachine\n";
  print_finding("CPU", value_in("/proc/cpuinfo", "model name"));
  const std::string simd = engine::simd_target();
  print_finding("SIMD", "kernels use " + simd,
                simd.starts_with("SSE") ? "networks run several times slower than with AVX2" : "");
  print_finding("processors", str(std::thread::hardware_concurrency()));
  print_blas();
  print_finding("memory", value_in("/proc/meminfo", "MemAvailable") + " available");
  std::error_code error;
  constexpr double kGigabyte = 1e9;
  const auto free = static_cast<double>(fs::space(".", error).available);
  print_finding("disk",
                error ? error.message() : str(std::round(free / kGigabyte), " GB free here"));
}

/// The state of a model, for files that are cached or partial.
bool print_model(const models::KnownModel& model, const fs::path& cache,
                 const std::map<std::string, fs::path>& loose) {
  using models::CacheState;
  const models::CacheEntry entry = models::inspect(cache, model, loose);
  if (entry.state == CacheState::kAbsent) return false;
  const std::string fetch = models::how_to_get(model, cache);
  print_finding(model.name, str(models::to_string(entry.state), ", ", entry.file.string()),
                entry.state == CacheState::kPartial     ? fetch
                : entry.state == CacheState::kIncorrect ? "remove it; " + fetch
                                                        : "");
  return entry.state == CacheState::kVerified || entry.state == CacheState::kUnverified;
}

void print_models() {
  std::cout << "\nmodels\n";
  try {
    const fs::path cache = models::cache_folder();
    const auto loose = models::loose_weights(cache);
    bool any = false;
    for (const models::KnownModel& model : models::known_models())
      any |= print_model(model, cache, loose);
    if (!any)
      print_finding(
          "trained network", str("none in ", cache.string()),
          "'revisit models fetch bvlc_alexnet', or give --model and --weights; to try the "
          "machinery: 'revisit models make-random -o DIR'");
  } catch (const Error& error) {
    print_finding("cache", error.what());
  }
}

struct DoctorOptions {
  std::optional<fs::path> data;
  ScanView scan;

  void declare(Options& options) {
    options.argument("DATA", &data).optional();
    scan.declare(options);
  }
};

int examine(DoctorOptions& o) {
  std::error_code none;
  const bool recorded = o.data && is_recording(*o.data);
  if (o.data && !recorded && fs::is_regular_file(*o.data, none)) {
    print_scan(*o.data, o.scan);
    return kOk;
  }
  if (o.scan.images) throw UsageError("--images: expected a scan file as DATA");
  if (recorded) {
    print_recording(*o.data);
    return kOk;
  }
  if (o.data) return print_data(*o.data) ? kOk : kCheckFailed;
  const bool ok = print_program();
  print_machine();
  print_models();
  return ok ? kOk : kCheckFailed;
}

}  // namespace

Command doctor_command() {
  return {
      "doctor", "examine the installation, a data set or a scan",
      "Prints what the program finds and how to fix what is missing: its build, the machine "
      "and the models; or, with DATA, the sequences of a data set, the scans of a recording, or "
      "the points, the alignment and the range image of a scan (.bin, .pcd or .ply). Exit "
      "code 5 if networks do not compute, or DATA is unusable.",
      "  revisit doctor\n"
      "  revisit doctor /data/kitti\n"
      "  revisit doctor sequences/00/velodyne/000052.bin --images look\n"
      "  revisit doctor scan.pcd --sensor vlp16 --align none --images look --gamma 2.5\n",
      with_options<DoctorOptions>(examine)};
}

}  // namespace revisit::cli

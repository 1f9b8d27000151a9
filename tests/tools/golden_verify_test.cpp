// References are from the original Caffe. tests/engine/golden_nets_test.cpp tests golden/nets of
// the shared data, which takes longest.
#include <google/protobuf/struct.pb.h>

#include "cli/json.h"
#include "revisit/engine/net.h"
#include "revisit/proto/net_file.h"
#include "revisit/proto/npy.h"
#include "testing.h"

namespace revisit {
namespace {

using google::protobuf::Struct;

Struct read_json(const fs::path& file) {
  Struct content;
  cli::read_report(file, &content);
  return content;
}

void expect_all_agree(const fs::path& folder, int cases) {
  const auto result = run_ok("net verify --threads 2 " + folder.string());
  EXPECT_HAS(result.out, str("\n", cases, " of ", cases, " cases agree"));
}

std::string text(const Struct& object, const char* key) {
  const auto found = object.fields().find(key);
  return found == object.fields().end() ? "" : found->second.string_value();
}

/// The layout of `net verify`, by symbolic links. Files of the test data have other names.
void link_case(const fs::path& folder, const fs::path& prototxt, const fs::path& weights,
               const fs::path& input, const fs::path& outputs) {
  fs::create_directories(folder);
  fs::create_symlink(prototxt, folder / "net.prototxt");
  fs::create_symlink(weights, folder / (weights.extension() == ".h5" ? "weights.caffemodel.h5"
                                                                     : "weights.caffemodel"));
  fs::create_symlink(input, folder / ("in_" + engine::input_blobs(prototxt).at(0) + ".npy"));
  for (const auto& entry : fs::directory_iterator(outputs))
    if (const std::string name = entry.path().filename(); name.starts_with("out_"))
      fs::create_symlink(entry.path(), folder / name);
}

/// Each pair of prototxt and weights in index.json.
void link_formats(const fs::path& to) {
  const fs::path from = test::golden("formats");
  google::protobuf::ListValue index;
  cli::read_report(from / "index.json", &index);
  int n = 0;
  for (const auto& value : index.values()) {
    const std::string prototxt = text(value.struct_value(), "prototxt"),
                      weights = text(value.struct_value(), "weights");
    link_case(to / str(++n), from / prototxt, from / weights, from / "in_data.npy", from);
  }
}

TEST(GoldenVerifyProject, EveryCaseAgrees) {
  expect_all_agree(test::golden("zoo"), 126);
  const TempDir formats;
  link_formats(formats.path());
  expect_all_agree(formats.path(), 22);
}

TEST(GoldenVerifyProject, Bf16ReportsEachLayer) {
  const TempDir formats;
  link_formats(formats.path());
  const auto result = run_ok("net verify --precision bf16 --layers " + formats.path().string());
  EXPECT_HAS(result.out, "error\n");
}

TEST(GoldenVerify, TrainedNetsAgree) {
  REVISIT_NEED_SHARED(all, "data/caffemodels");
  const TempDir cases;
  int n = 0;
  for (const auto& entry : fs::recursive_directory_iterator(all)) {
    if (entry.path().filename() != "in.npy") continue;
    const fs::path folder = entry.path().parent_path();  // a net, or another size of one
    const fs::path net = fs::exists(folder / "deploy.prototxt") ? folder : folder.parent_path();
    const bool hdf5 = fs::exists(net / "weights.caffemodel.h5");
    link_case(cases / str(++n), net / "deploy.prototxt",
              net / (hdf5 ? "weights.caffemodel.h5" : "weights.caffemodel"), entry.path(), folder);
  }
  expect_all_agree(cases.path(), 9);
}

TEST(GoldenVerify, NetsOfReducedWidthAgree) {
  REVISIT_NEED_SHARED(slim, "golden/slim");
  const TempDir cases;
  for (const auto& entry : fs::directory_iterator(slim)) {
    if (!entry.is_directory()) continue;
    const fs::path folder = entry.path();
    const Struct manifest = read_json(folder / "manifest.json");
    link_case(cases / folder.filename(), folder / "deploy.prototxt", folder / "weights.caffemodel",
              folder / text(manifest, "input"), folder);
  }
  expect_all_agree(cases.path(), 12);
}

engine::Run forward(const engine::Net& net, const proto::Blob& input, bool reference_kernels) {
  const std::string blob = net.inputs().at(0).name;
  engine::Run run(
      net.plan({{blob, engine::Shape(input.shape)}},
               {.threads = 2, .keep_all = true, .reference_kernels = reference_kernels}));
  std::ranges::copy(input.data, run.input(blob).data);
  run.forward();
  return run;
}

/// Differences of the largest magnitude, the root mean square, and the first and last values from
/// those of the original's layer, relative to its largest magnitude.
double error_of_statistics(std::span<const float> values, const Struct& layer) {
  const auto real = [&](const char* key) { return layer.fields().at(key).number_value(); };
  double squares = 0, largest = 0;
  for (const float value : values) {
    squares += static_cast<double>(value) * value;
    largest = std::max(largest, std::abs(static_cast<double>(value)));
  }
  const double rms = std::sqrt(squares / static_cast<double>(values.size()));
  double error = std::max(std::abs(largest - real("absmax")), std::abs(rms - real("rms")));
  const auto& first = layer.fields().at("first").list_value();
  const auto& last = layer.fields().at("last").list_value();
  for (int i = 0; i < first.values_size(); ++i) {
    const size_t at_end = values.size() - last.values_size() + i;
    error = std::max(error, std::abs(values[i] - first.values(i).number_value()));
    error = std::max(error, std::abs(values[at_end] - last.values(i).number_value()));
  }
  return real("absmax") > 0 ? error / real("absmax") : error;
}

/// Layers of which the original's values, or statistics of them, are in the manifest.
void expect_layers_agree(const fs::path& folder) {
  const Struct manifest = read_json(folder / "manifest.json");
  const auto net = engine::Net::load(folder / "deploy.prototxt", folder / "weights.caffemodel");
  const proto::Blob input = proto::read_npy(folder / text(manifest, "input"));
  const engine::Run run = forward(net, input, false), reference = forward(net, input, true);
  double rounding = 0;
  bool winograd = false;
  for (const engine::LayerCost& layer : run.plan().layers()) {
    winograd |= layer.winograd;
    rounding = std::max(rounding, relative_error(run.layer_output(layer.name).values(),
                                                 reference.layer_output(layer.name).values()));
  }
  // Some nets amplify rounding: compare_case() in net_verify.cpp.
  const double tolerance = winograd ? 1e-4 : std::max(1e-5, std::min(1e-4, 2 * rounding));
  int index = -1, port = 0;
  for (const auto& value : manifest.fields().at("layers").list_value().values()) {
    const Struct& layer = value.struct_value();
    const int at = static_cast<int>(layer.fields().at("index").number_value());
    port = at == index ? port + 1 : 0;
    index = at;
    if (text(layer, "type") == "Split") continue;  // Caffe inserts them
    const std::string name = proto::port_name(text(layer, "layer"), port);
    const auto found = run.layer_output(name).values();
    double error = error_of_statistics(found, layer);
    if (const std::string file = text(layer, "file"); !file.empty())
      error =
          std::max(error, relative_error(found, proto::read_npy(folder / "layers" / file).data));
    EXPECT_LE(error, tolerance) << name;
  }
}

TEST(GoldenVerify, EachLayerOfNetsOfReducedWidthAgrees) {
  REVISIT_NEED_SHARED(slim, "golden/slim");
  for (const auto& entry : fs::directory_iterator(slim)) {
    if (!entry.is_directory()) continue;
    SCOPED_TRACE(entry.path().filename());
    expect_layers_agree(entry.path());
  }
}

}  // namespace
}  // namespace revisit

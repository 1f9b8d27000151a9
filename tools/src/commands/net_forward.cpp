#include <algorithm>
#include <iostream>
#include <numeric>
#include <set>

#include "cli/gray_array.h"
#include "cli/mean_file.h"
#include "cli/printable.h"
#include "cli/table.h"
#include "net_commands.h"
#include "revisit/base/folder.h"
#include "revisit/proto/npy.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

/// "BLOB=FILE", or "FILE" alone for a net with one input.
std::pair<std::string, fs::path> split_blob(const std::string& option, const std::string& text,
                                            const std::vector<std::string>& blobs) {
  const size_t equals = text.find('=');
  if (equals == std::string::npos) {
    if (blobs.size() != 1)
      throw UsageError(option, ": the net has ", blobs.size(),
                       " inputs; say which one: BLOB=", text);
    return {blobs[0], text};
  }
  const std::string blob = text.substr(0, equals);
  if (std::find(blobs.begin(), blobs.end(), blob) == blobs.end())
    throw UsageError(option, ": the net has no input '", blob, "'", did_you_mean(blob, blobs));
  return {blob, text.substr(equals + 1)};
}

/// Arrays for the net's inputs, by blob name, means subtracted.
std::map<std::string, proto::NpyArray> read_inputs(const std::vector<std::string>& inputs,
                                                   const std::vector<std::string>& means,
                                                   const std::vector<std::string>& blobs) {
  std::map<std::string, proto::NpyArray> arrays;
  for (const std::string& text : inputs) {
    const auto [blob, file] = split_blob("--input", text, blobs);
    arrays[blob] = proto::read_npy(file);
  }
  for (const std::string& text : means) {
    const auto [blob, file] = split_blob("--mean", text, blobs);
    const auto found = arrays.find(blob);
    if (found == arrays.end())
      throw UsageError("--mean: the input '", blob, "' has no array to subtract it from");
    subtract(read_mean(file), engine::Shape(found->second.shape), found->second.data.data());
  }
  return arrays;
}

/// `out_NAME.npy` with '/' in the name written as '_' and control characters as \x1b.
fs::path output_file(const fs::path& directory, std::string name, std::set<fs::path>& taken) {
  std::replace(name.begin(), name.end(), '/', '_');
  const fs::path file = directory / ("out_" + printable(name) + ".npy");
  if (!taken.insert(file).second) throw Error("two outputs would be written to ", file.string());
  return file;
}

}  // namespace

int net_forward_command(const Arguments& arguments) {
  NetOptions options;
  std::vector<std::string> inputs, means;
  fs::path directory;
  bool all = false, reference = false, gray = false;
  Parser parser(
      "revisit net forward", "PROTOTXT [WEIGHTS] --input BLOB=FILE.npy... -o DIR",
      "Run a Caffe net on arrays: the inputs take the shapes of the arrays, each output is written "
      "to DIR/out_NAME.npy (float32, C order; '/' in names becomes '_').",
      "  revisit net forward deploy.prototxt model.caffemodel --input data=in.npy -o out\n"
      "  revisit net forward alexnet.prototxt alexnet.caffemodel --input data=in.npy --end conv3 "
      "--graft pool5 -o out\n");
  options.declare(parser);
  parser.group("Arrays:");
  parser.option("input", "BLOB=FILE.npy",
                "array for one input (float32 or float64); repeat for more", &inputs, 'i');
  parser.option("mean", "BLOB=FILE",
                "mean to subtract from an input: .binaryproto or .npy, an image (its centre when "
                "larger) or one value per channel",
                &means);
  parser.option("output", "DIR", "folder for the outputs", &directory, 'o');
  parser.flag("all", "write every layer's output, as it was right after that layer ran", &all);
  parser.flag("gray",
              "the input's channels are one picture, up to a constant each: the first convolution "
              "reads it once",
              &gray);
  parser.flag("reference", "use the slow reference kernels", &reference);
  parser.parse(arguments);
  if (directory.empty()) throw UsageError("give the folder for the outputs: -o DIR");

  std::map<std::string, proto::NpyArray> arrays = read_inputs(inputs, means, options.input_blobs());
  for (const auto& [blob, array] : arrays)
    options.input_shapes.push_back(blob + "=" + engine::Shape(array.shape).text());
  const engine::Net net = load_net(options, NoWeights::kNone);
  engine::PlanOptions plan = options.plan_options();
  plan.keep_all = all;
  plan.reference_kernels = reference;
  if (gray) {
    if (arrays.size() != 1) throw UsageError("--gray: expected one --input, the net's only one");
    auto& [blob, array] = *arrays.begin();
    plan.gray_offsets = gray_offsets(array, "--input " + blob);
    array.data = first_channels(array);
  }
  engine::Run run(net.plan({}, plan));

  for (const engine::Port& port : run.plan().inputs()) {
    const auto found = arrays.find(port.name);
    if (found == arrays.end())
      throw UsageError("the input '", port.name, "' needs an array: --input ", port.name,
                       "=FILE.npy");
    std::copy(found->second.data.begin(), found->second.data.end(), run.input(port.name).data);
  }
  run.forward();

  std::vector<std::string> names;
  if (all) {
    for (const engine::LayerCost& layer : run.plan().layers())
      for (size_t port = 0; port < layer.outputs.size(); ++port)
        names.push_back(engine::port_name(layer.name, port));
  } else {
    names = net.outputs();
  }
  make_folder(directory);
  std::set<fs::path> taken;
  Table table({"output", "shape", "min", "max", "mean", "file"});
  for (const std::string& name : names) {
    const engine::View<const float> output = all ? run.layer_output(name) : run.output(name);
    const auto values = output.values();
    const fs::path file = output_file(directory, name, taken);
    proto::write_npy(file, output.shape.axes(), output.data);
    if (values.empty()) {  // no row passed a filter
      table.row({name, output.shape.text(), "", "", "", file.string()});
      continue;
    }
    const auto [least, most] = std::minmax_element(values.begin(), values.end());
    const double mean =
        std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
    table.row({name, output.shape.text(), str(*least), str(*most), str(mean), file.string()});
  }
  table.print(std::cout);
  return kOk;
}

}  // namespace revisit::cli

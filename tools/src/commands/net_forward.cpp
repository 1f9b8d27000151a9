#include <algorithm>
#include <functional>
#include <iostream>
#include <numeric>
#include <optional>
#include <set>

#include "cli/net_arrays.h"
#include "cli/terminal.h"
#include "net_commands.h"
#include "revisit/base/files.h"
#include "revisit/proto/net_file.h"
#include "revisit/proto/npy.h"
#ifdef REVISIT_HAVE_PIPELINE  // the other builds have no readers of pictures
#include "pictures/picture.h"
#endif

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

/// "BLOB=FILE", or "FILE" alone for a net with one input.
std::pair<std::string, fs::path> split_blob(const std::string& option, const std::string& text,
                                            const std::vector<std::string>& blobs) {
  const size_t equals = text.find('=');
  if (equals == std::string::npos) {
    if (blobs.size() != 1)
      throw UsageError(option, ": the net has ", blobs.size(), " inputs; name one: BLOB=", text);
    return {blobs[0], text};
  }
  const std::string blob = text.substr(0, equals);
  if (std::find(blobs.begin(), blobs.end(), blob) == blobs.end())
    throw UsageError(option, ": the net has no input '", blob, "'", nearest_name_hint(blob, blobs));
  return {blob, text.substr(equals + 1)};
}

using Arrays = std::map<std::string, proto::Blob>;  // by blob name

/// Files of --input: arrays, and pictures by blob.
struct Inputs {
  Arrays arrays;
  std::map<std::string, std::vector<fs::path>> pictures;
};

bool is_picture(const fs::path& file) {
  const std::string head = read_head(file, 4);
  return head == "\x89PNG" || head.starts_with("\xff\xd8");
}

Inputs read_inputs(const std::vector<std::string>& files, const std::vector<std::string>& blobs) {
  Inputs inputs;
  for (const std::string& text : files) {
    const auto [blob, file] = split_blob("--input", text, blobs);
    if (is_picture(file))
      inputs.pictures[blob].push_back(file);
    else
      inputs.arrays[blob] = proto::read_npy(file);
    if (inputs.pictures.contains(blob) && inputs.arrays.contains(blob))
      throw UsageError("--input: '", blob, "' has an array and a picture");
  }
  return inputs;
}

void subtract_means(const std::vector<std::string>& means, const std::vector<std::string>& blobs,
                    Arrays* arrays) {
  for (const std::string& text : means) {
    const auto [blob, mean] = split_blob("--mean", text, blobs);
    const auto found = arrays->find(blob);
    if (found == arrays->end())
      throw UsageError("--mean: the input '", blob, "' has no array to subtract it from");
    subtract(parse_mean_option("--mean", mean), engine::Shape(found->second.shape),
             found->second.data.data());
  }
}

struct PictureOptions {
  std::optional<double> scale;
  std::optional<bool> rgb;

  void declare([[maybe_unused]] Options& options) {
#ifdef REVISIT_HAVE_PIPELINE
    options.group("Pictures:");
    options
        .option("input-scale", "S",
                "factor of pictures after the mean is subtracted, e.g. 0.00390625 for 0 to 1 "
                "(default 1)",
                &scale)
        .positive();
    options.choice<bool>("channels", {{"bgr", false}, {"rgb", true}},
                         "order of the channels of pictures and of --mean, which is not reordered "
                         "(default bgr, Caffe's)",
                         &rgb);
#endif
  }

  /// Resizes pictures to their input of `net`.
  void resize([[maybe_unused]] const engine::Net& net, Inputs& inputs) const {
    if (inputs.pictures.empty() && (scale || rgb))
      throw UsageError(scale ? "--input-scale" : "--channels", ": needs a picture as --input");
#ifdef REVISIT_HAVE_PIPELINE
    for (const engine::Port& port : net.inputs())
      if (const auto found = inputs.pictures.find(port.name); found != inputs.pictures.end())
        inputs.arrays[port.name] =
            picture_input(found->second, port.name, port.shape, rgb.value_or(false));
#else
    if (!inputs.pictures.empty())
      throw UsageError("--input: this program was built without readers of pictures");
#endif
  }
};

#ifdef REVISIT_HAVE_PIPELINE
constexpr bool kReadsPictures = true;
constexpr const char* kPictureExamples =
    "  revisit net forward net.prototxt net.caffemodel --input cat.jpg --mean mean.npy --labels "
    "words.txt\n"
    "  revisit net forward net.prototxt net.caffemodel --input cat.jpg --mean 104,117,123 -o out\n";
#else
constexpr bool kReadsPictures = false;
constexpr const char* kPictureExamples = "";
#endif

/// Path of `out_NAME.npy`; '/' in the name becomes '_', and control characters are escaped.
fs::path output_file(const fs::path& directory, std::string name, std::set<fs::path>& taken) {
  std::replace(name.begin(), name.end(), '/', '_');
  const fs::path file = directory / ("out_" + printable(name) + ".npy");
  if (!taken.insert(file).second) throw Error("two outputs would be written to ", file.string());
  return file;
}

/// Mean outputs over the passes. `all`: names are layers, not outputs of the net.
Arrays average(engine::Run& run, const std::vector<std::string>& names, bool all, int passes) {
  Arrays means;
  std::map<std::string, std::vector<double>> sums;
  for (int pass = 0; pass < passes; ++pass) {
    run.forward();
    for (const std::string& name : names) {
      const engine::View<const float> output = all ? run.layer_output(name) : run.output(name);
      const auto values = output.values();
      if (pass == 0) {
        means[name].shape = output.shape.axes();
        sums[name].assign(values.begin(), values.end());
        continue;
      }
      if (const auto& shape = means[name].shape; shape != output.shape.axes())
        throw UsageError("--samples: '", name, "' has ", shape_text(shape),
                         " numbers in one pass and ", output.shape,
                         " in another: end the net before it (--end)");
      std::ranges::transform(sums[name], values, sums[name].begin(), std::plus());
    }
  }
  for (auto& [name, mean] : means)
    for (const double sum : sums[name]) mean.data.push_back(static_cast<float>(sum / passes));
  return means;
}

struct ForwardOptions {
  NetOptions net;
  PictureOptions pictures;
  std::vector<std::string> inputs, means;
  std::optional<fs::path> directory, label_file;
  bool all = false, reference = false, gray = false;
  int samples = 1;
  uint64_t seed = 0;

  void declare(Options& options) {
    net.declare(options);
    options.group("Arrays:");
    options.option("input", "[BLOB=]FILE",
                   kReadsPictures ? "repeatable: .npy array (float32 or float64); or PNG or JPEG "
                                    "for an input of 3 channels or 1 (gray), resized to its rows "
                                    "and columns, several as a batch; EXIF rotation is ignored"
                                  : ".npy array for an input (float32 or float64), repeatable",
                   &inputs, 'i');
    options.option(
        "mean", "[BLOB=]M,M,M|M|FILE",
        "mean to subtract from an input: numbers per channel, one for all, or a .binaryproto or "
        ".npy file with an image (cropped to its center) or a value per channel (default: none)",
        &means);
    options.option("output", "DIR", "folder of the outputs", &directory, 'o');
    options
        .option("labels", "FILE",
                "names of classes (line 1: class 0), for the five best classes of each picture",
                &label_file)
        .excludes({"all"});
    options.flag("all", "output of every layer, right after it ran (default: outputs of the net)",
                 &all);
    options.flag("single-channel",
                 "input of one channel, replicated up to a constant per channel, which the first "
                 "convolution reads once",
                 &gray);
    options
        .option(
            "samples", "N",
            "passes whose outputs are averaged, for Dropout with sample_weights_test (default 1)",
            &samples)
        .at_least(1);
    options.option("seed", "N", "seed of Dropout (default 0)", &seed);
    options.flag("reference", "slow reference kernels", &reference);
    pictures.declare(options);
  }
};

/// Writes arrays into `folder` and prints a table of them.
void write_outputs(const std::vector<std::string>& names, const Arrays& outputs,
                   const fs::path& folder) {
  make_folder(folder);
  std::set<fs::path> taken;
  Table table({"output", "shape", "min", "max", "mean", "file"});
  for (const std::string& name : names) {
    const std::vector<float>& values = outputs.at(name).data;
    const std::vector<int64_t>& shape = outputs.at(name).shape;
    const fs::path file = output_file(folder, name, taken);
    proto::write_npy(file, shape, values.data());
    if (values.empty()) {  // no row passed a filter
      table.row({name, shape_text(shape), "", "", "", file.string()});
      continue;
    }
    const auto [least, most] = std::minmax_element(values.begin(), values.end());
    const double mean =
        std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
    table.row({name, shape_text(shape), str(*least), str(*most), str(mean), file.string()});
  }
  table.print(std::cout);
}

std::vector<std::string> layer_outputs(const engine::Plan& plan) {
  std::vector<std::string> names;
  for (const engine::LayerCost& layer : plan.layers())
    for (size_t port = 0; port < layer.outputs.size(); ++port)
      names.push_back(proto::port_name(layer.name, port));
  return names;
}

void fill_inputs(const Arrays& arrays, engine::Run* run) {
  for (const engine::Port& port : run->plan().inputs()) {
    const auto found = arrays.find(port.name);
    if (found == arrays.end())
      throw UsageError("the input '", port.name, "' needs an array: --input ", port.name,
                       "=FILE.npy");
    std::copy(found->second.data.begin(), found->second.data.end(), run->input(port.name).data);
  }
}

int forward(ForwardOptions& o) {
  if (!o.directory && !o.label_file)
    throw UsageError("missing required option --output DIR or --labels FILE");
  std::vector<std::string> labels;
  if (o.label_file) labels = read_labels(*o.label_file);

  const std::vector<std::string> blobs = o.net.input_blobs();
  Inputs inputs = read_inputs(o.inputs, blobs);
  Arrays& arrays = inputs.arrays;
  for (const auto& [blob, array] : arrays)
    o.net.input_shapes.push_back(blob + "=" + engine::Shape(array.shape).text());
  const engine::Net loaded = load_net(o.net, NoWeights::kNone);
  if (loaded.outputs().empty() && !o.all)
    throw UsageError("the net has no output: name the blob to output, with --end");
  std::map<std::string, engine::Shape> shapes;
  o.pictures.resize(loaded, inputs);
  subtract_means(o.means, blobs, &arrays);
  for (const auto& [blob, files] : inputs.pictures) {
    for (float& value : arrays[blob].data)
      value *= static_cast<float>(o.pictures.scale.value_or(1));
    shapes.emplace(blob, arrays[blob].shape);
  }
  engine::PlanOptions plan = o.net.plan_options();
  plan.keep_all = o.all;
  plan.reference_kernels = o.reference;
  plan.seed = o.seed;
  if (o.gray) {
    if (arrays.size() != 1)
      throw UsageError("--single-channel: expected one input, found ", arrays.size());
    auto& [blob, array] = *arrays.begin();
    plan.channel_offsets = channel_offsets(array, "--input " + blob);
    array.data = first_channels(array);
  }
  engine::Run run(loaded.plan(shapes, plan));
  const std::vector<std::string> classified =
      o.label_file ? classifying(run.plan(), *o.label_file, labels.size())
                   : std::vector<std::string>{};

  fill_inputs(arrays, &run);
  const std::vector<std::string> names = o.all ? layer_outputs(run.plan()) : loaded.outputs();
  const Arrays outputs = average(run, names, o.all, o.samples);
  for (const std::string& name : classified)
    print_best_classes(name, outputs.at(name).data, labels);
  if (!o.directory) return kOk;
  write_outputs(names, outputs, *o.directory);
  return kOk;
}

}  // namespace

Command net_forward_command() {
  return {
      "forward", "outputs for .npy arrays or pictures",
      "Runs a Caffe net on arrays or pictures. Inputs take the shapes of arrays; pictures are "
      "resized to the input. Each output is written to DIR/out_NAME.npy (float32, C order; '/' in "
      "names becomes '_'). With --labels it prints the best classes, and -o is optional. Layers "
      "with weights need WEIGHTS: 'revisit models make-random --net PROTOTXT' writes random ones.",
      std::string("  revisit net forward net.prototxt net.caffemodel --input data=in.npy -o out\n"
                  "  revisit net forward net.prototxt net.caffemodel --input data=in.npy --end "
                  "conv3 -o out\n") +
          kPictureExamples,
      with_options<ForwardOptions>(forward)};
}

}  // namespace revisit::cli

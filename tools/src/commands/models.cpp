#include <algorithm>
#include <iostream>
#include <limits>
#include <set>

#include "cli/command.h"
#include "cli/interrupt.h"
#include "cli/json.h"
#include "cli/messages.h"
#include "cli/net_options.h"
#include "cli/parser.h"
#include "cli/progress.h"
#include "cli/table.h"
#include "models/cache.h"
#include "models/fetch.h"
#include "models/find_model.h"
#include "reports.pb.h"
#include "revisit/base/text.h"
#include "revisit/engine/net.h"
#include "revisit/proto/net_file.h"
#include "revisit/weights_conversion/random_model.h"
#include "revisit/weights_conversion/trunks.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

constexpr double kMegabyte = 1e6;

struct ModelsFolder {
  std::optional<fs::path> given;

  void declare(Parser& parser) {
    parser.option("models", "DIR",
                  "folder of models (default: $REVISIT_MODELS or ~/.cache/revisit/models)", &given);
  }
  fs::path path() const { return given ? *given : models::cache_folder(); }
};

std::string cuts_text(const models::KnownModel& model) {
  return joined(model.cuts, " ", [](const models::Cut& cut) { return models::to_string(cut); });
}

std::string size_text(const models::CacheEntry& entry) {
  if (entry.state == models::CacheState::kAbsent) return "";
  return number(static_cast<double>(entry.size) / kMegabyte, 1) + " MB";
}

void add_to_report(const models::KnownModel& model, const models::CacheEntry& entry,
                   reports::KnownModels& report) {
  reports::KnownModel& item = *report.add_models();
  item.set_name(model.name);
  item.set_state(models::to_string(entry.state));
  item.set_file(entry.file.string());
  if (entry.state != models::CacheState::kAbsent) item.set_bytes(static_cast<double>(entry.size));
  if (!entry.sha1.empty()) item.set_sha1_found(entry.sha1);
  if (!model.sha1.empty()) {
    item.set_sha1(model.sha1);
    item.set_sha1_source(model.sha1_source);
  }
  if (!model.address.empty()) item.set_address(model.address);
  item.set_needs_browser(model.needs_browser);
  item.set_prototxt(model.prototxt_address);
  if (!model.trunk.empty()) item.set_own_prototxt(model.trunk);
  item.set_licence(model.licence);
  if (model.mean_bgr)
    for (const double value : *model.mean_bgr) item.add_mean_bgr(value);
  item.set_input_size(model.input_size);
  for (const models::Cut& cut : model.cuts) item.add_cuts(models::to_string(cut));
  item.set_notes(model.notes);
}

int list_command(const Arguments& arguments) {
  std::string format = "table";
  ModelsFolder folder;
  Parser parser("revisit models list", "",
                "Lists the known Caffe models, whether they are cached, and whether their "
                "checksums match.",
                "  revisit models list\n  revisit models list --format json\n");
  parser.choice("format", {"table", "json", "csv"}, "format of standard output (default table)",
                &format);
  folder.declare(parser);
  parser.parse(arguments);

  const fs::path cache = folder.path();
  reports::KnownModels report;
  report.set_cache(cache.string());
  const bool csv = format == "csv";
  std::vector<std::string> header{"model", "state", "size", "licence", "input", "feature layers"};
  if (csv)
    header = {"model",   "state",    "bytes",      "sha1_found",     "sha1",     "address", "file",
              "licence", "mean_bgr", "input_size", "feature_layers", "prototxt", "notes"};
  Table table(header);
  const auto loose = models::loose_weights(cache);
  for (const models::KnownModel& model : models::known_models()) {
    const models::CacheEntry entry = models::inspect(cache, model, loose);
    add_to_report(model, entry, report);
    const std::string state = models::to_string(entry.state), input = str(model.input_size);
    if (csv)
      table.row({model.name, state, entry.size ? str(entry.size) : "", entry.sha1, model.sha1,
                 model.address, entry.file.string(), model.licence,
                 model.mean_bgr ? joined(*model.mean_bgr, " ") : "", input, cuts_text(model),
                 model.prototxt_address, model.notes});
    else
      table.row({model.name, state, size_text(entry), model.licence, input, cuts_text(model)});
  }
  print_report(format, report, table);
  if (format == "table")
    std::cout << "\ncache: " << cache.string()
              << "\n'revisit models fetch NAME' downloads one; --format json prints addresses and "
                 "checksums.\n";
  return kOk;
}

models::DownloadOptions download_options(Progress& progress) {
  models::DownloadOptions options;
  options.stop = interrupted;
  options.progress = [&progress](int64_t done, int64_t total) {
    constexpr auto kUnit = static_cast<int64_t>(kMegabyte);
    if (total > 0) progress.update(done / kUnit, total / kUnit);
  };
  return options;
}

void print_fetched(const models::KnownModel& model, const models::Fetched& fetched) {
  std::cout << model.name << ": " << fetched.file.string()
            << (fetched.was_there ? " (cached)\n" : "\n");
  if (fetched.verified)
    std::cout << "sha1 " << fetched.sha1 << ": as published (" << model.sha1_source << ")\n";
  else if (model.sha1.empty())
    std::cout << "sha1 " << fetched.sha1
              << ": not checked, because no checksum of this model is published\n";
  else
    std::cout << "sha1 " << fetched.sha1 << ": not verified; an unofficial source has "
              << model.sha1 << " (" << model.sha1_source << ")\n";
  std::cout << "license: " << model.licence << "\n";
  if (fetched.file.string().ends_with(".tar.gz"))
    std::cout << "an archive; unpack it: tar -xzf '" << fetched.file.string()
              << "' --strip-components=1 -C '" << fetched.file.parent_path().string() << "'\n";
  if (!fetched.prototxt.empty())
    std::cout << "prototxt: " << fetched.prototxt.string() << "\nuse it: revisit eval DATA --model "
              << model.name << "\n";
  else
    std::cout << "prototxt, to be saved beside it as deploy.prototxt: " << model.prototxt_address
              << "\n";
}

int fetch_command(const Arguments& arguments) {
  std::string name;
  ModelsFolder folder;
  bool no_progress = false;
  Parser parser("revisit models fetch", "NAME",
                "Downloads a known model into the cache and checks its checksum. If interrupted, "
                "run the same command "
                "again to resume.",
                "  revisit models fetch bvlc_alexnet\n"
                "  revisit models fetch squeezenet_v1.1 --models /data/models\n");
  parser.positional("NAME", &name).suggest(models::known_model_names());
  folder.declare(parser);
  parser.flag("no-progress", "no progress line", &no_progress);
  parser.parse(arguments);

  const models::KnownModel& model = models::known_model(name);
  const models::Fetched fetched = [&] {
    Progress progress("fetching " + model.name, "MB", !no_progress);
    return models::fetch_model(model, folder.path(), download_options(progress));
  }();
  print_fetched(model, fetched);
  return kOk;
}

int which_command(const Arguments& arguments) {
  models::ModelRequest request;
  Parser parser(
      "revisit models which", "",
      "Prints the network that a command with the same options would use.",
      "  revisit models which\n  revisit models which --weights net/weights.caffemodel\n");
  parser.option("model", "P", "prototxt, its folder, or the name of a known model", &request.model)
      .suggest(models::known_model_names());
  parser.option("weights", "W", "caffemodel", &request.weights);
  parser.option("end", "LAYER", "layer whose output is the feature", &request.end);
  parser.option("graft", "LAYER", "pooling layer appended after --end, e.g. pool5", &request.graft);
  parser.parse(arguments);

  const models::FoundModel found = models::find_model(request);
  for (const std::string& warning : found.warnings) warn(warning);
  std::cout << "network:   " << found.name << (found.trained ? "" : " (UNTRAINED)")
            << "\nprototxt:  " << found.prototxt.string()
            << "\nweights:   " << found.weights.string()
            << "\nfeature:   " << models::to_string(found.cut) << "\nmean BGR: ";
  for (const double value : found.mean_bgr) std::cout << " " << value;
  std::cout << "\n";
  return kOk;
}

/// Throws InputError, before weights are made, if a caffemodel cannot hold or assign them.
void check_writable(const NetOptions& options) {
  const engine::Plan plan =
      engine::Net::load_without_weights(options.prototxt, options.load_options())
          .plan({}, {.max_run_bytes = std::numeric_limits<int64_t>::max()});
  if (plan.weight_bytes() > std::numeric_limits<int32_t>::max())
    throw InputError(options.prototxt.string(), ": its weights take ", plan.weight_bytes(),
                     " bytes (a caffemodel holds at most 2^31-1)");
  std::set<std::string> known;
  for (const engine::LayerCost& layer : plan.layers())
    if (!known.insert(layer.name).second && !layer.weights.empty())
      throw InputError(
          options.prototxt.string(), ": layer '", layer.name, "' (", layer.type,
          ") has weights and the name of an earlier layer, to which a caffemodel would "
          "assign them; rename one");
}

/// Writes the inference layers of any prototxt, with the random weights that profiling uses.
models::ModelFiles write_random_net(const fs::path& folder, const NetOptions& options) {
  check_writable(options);
  const engine::Net net = load_net(options, NoWeights::kRandom);
  caffe::NetParameter file =
      proto::read_net(options.prototxt, {.allow_unknown_fields = options.allow_unknown,
                                         .types_with_weights = engine::types_with_weights(),
                                         .limits = options.limits.limits()})
          .net;
  set_input_shapes(options.prototxt, options.input_shapes, &file);
  for (caffe::LayerParameter& layer : *file.mutable_layer()) layer.clear_blobs();
  int at = 0;
  for (const engine::LayerWeights& weights : net.weights()) {
    while (file.layer(at).name() != weights.layer) ++at;  // both in the order of the file
    for (const auto& blob : weights.blobs) {
      caffe::BlobProto& out = *file.mutable_layer(at)->add_blobs();
      out.mutable_shape()->mutable_dim()->Add(blob.shape.axes().begin(), blob.shape.axes().end());
      out.mutable_data()->Add(blob.values().begin(), blob.values().end());
    }
    ++at;
  }
  return models::write_untrained(folder, options.prototxt.stem().string(), options.seed,
                                 std::move(file));
}

int make_random_command(const Arguments& arguments) {
  NetOptions options;
  std::string net = "alexnet";
  fs::path output;
  Parser parser("revisit models make-random", "-o DIR",
                "Writes a network with random weights, for tests without a download: one of this "
                "project, or the inference "
                "layers of any prototxt. Weights are He-scaled, so that values keep their size "
                "from layer to layer. The "
                "network is not trained, so results do not measure accuracy. A seed gives the same "
                "files everywhere.",
                "  revisit models make-random -o /tmp/random\n"
                "  revisit models make-random --net vgg_cnn_s --seed 7 -o /tmp/random\n"
                "  revisit models make-random --net deploy.prototxt -o /tmp/random\n"
                "  revisit models make-random --net train_val.prototxt --input-shape 1,3,224,224 "
                "-o /tmp/random\n");
  const std::vector<std::string>& known = models::trunk_names();
  parser
      .option("net", joined(known, "|") + "|FILE", "network, or a prototxt (default alexnet)", &net)
      .suggest(known);
  declare_input_shape(parser, &options.input_shapes);
  parser.option("seed", "N", "seed of the weights (default 1)", &options.seed);
  parser.option("output", "DIR", "folder of NET_random.prototxt and .caffemodel", &output, 'o');
  parser.flag("allow-unknown",
              "warnings for unknown fields outside of layer parameters (default: errors)",
              &options.allow_unknown);
  options.limits.declare(parser);
  parser.parse(arguments);
  if (output.empty()) throw UsageError("missing required option --output DIR");

  options.prototxt = net;
  const bool is_known = std::ranges::find(known, net) != known.end();
  if (is_known && !options.input_shapes.empty())
    throw UsageError("--input-shape: not with ", net, ", only with a prototxt");
  if (!is_known && !options.prototxt.has_extension() && !fs::exists(options.prototxt))
    throw UsageError("--net: expected a prototxt, ", joined(known, ", "), "; found '", net, "'",
                     nearest_name_hint(net, known));

  const models::ModelFiles files = is_known ? models::write_random_model(output, net, options.seed)
                                            : write_random_net(output, options);
  std::cout << files.prototxt.string() << "\n" << files.weights.string() << "\n";
  std::cerr << "untrained: random weights (seed " << options.seed
            << "); results do not measure accuracy\n";
  return kOk;
}

}  // namespace

int models_command(const Arguments& arguments) {
  return dispatch("revisit models", "Known Caffe models, and random ones.\n",
                  {{"list", "known models, and which are cached", list_command},
                   {"fetch", "download a model and check it", fetch_command},
                   {"which", "network that a command would use", which_command},
                   {"make-random", "untrained network with random weights", make_random_command}},
                  arguments);
}

}  // namespace revisit::cli

#include <algorithm>
#include <iostream>
#include <limits>
#include <set>

#include "cli/command.h"
#include "cli/interrupt.h"
#include "cli/json.h"
#include "cli/messages.h"
#include "cli/net_options.h"
#include "cli/options.h"
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

  void declare(Options& options) {
    options.option("models", "DIR",
                   "folder of models (default: $REVISIT_MODELS or ~/.cache/revisit/models)",
                   &given);
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

struct ListOptions {
  std::string format = "table";
  ModelsFolder folder;

  void declare(Options& options) {
    options.choice("format", {"table", "json", "csv"}, "format of standard output (default table)",
                   &format);
    folder.declare(options);
  }
};

int list_models(ListOptions& o) {
  const fs::path cache = o.folder.path();
  reports::KnownModels report;
  report.set_cache(cache.string());
  const bool csv = o.format == "csv";
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
  print_report(o.format, report, table);
  if (o.format == "table")
    std::cout << "\ncache: " << cache.string()
              << "\n'revisit models fetch NAME' downloads one; --format json prints addresses and "
                 "checksums.\n";
  return kOk;
}

Command list_command() {
  return {
      "list", "known models, and which are cached",
      "Lists the known Caffe models, whether they are cached, and whether their checksums match.",
      "  revisit models list\n  revisit models list --format json\n",
      with_options<ListOptions>(list_models)};
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

struct FetchOptions {
  std::string name;
  ModelsFolder folder;

  void declare(Options& options) {
    options.argument("NAME", &name).suggest(models::known_model_names());
    folder.declare(options);
  }
};

int fetch_models(FetchOptions& o) {
  const models::KnownModel& model = models::known_model(o.name);
  const models::Fetched fetched = [&] {
    Progress progress("fetching " + model.name, "MB");
    return models::fetch_model(model, o.folder.path(), download_options(progress));
  }();
  print_fetched(model, fetched);
  return kOk;
}

Command fetch_command() {
  return {"fetch", "download a model and check it",
          "Downloads a known model into the cache and checks its checksum. If interrupted, run the "
          "same command again to resume.",
          "  revisit models fetch bvlc_alexnet\n"
          "  revisit models fetch squeezenet_v1.1 --models /data/models\n",
          with_options<FetchOptions>(fetch_models)};
}

struct WhichOptions {
  models::ModelRequest request;
  std::string end;

  void declare(Options& options) {
    options
        .option("model", "P", "prototxt, its folder, or the name of a known model", &request.model)
        .suggest(models::known_model_names());
    options.option("weights", "W", "caffemodel", &request.weights);
    options.option("end", "LAYER[+LAYER]",
                   "layer whose output is the feature, or conv3+pool5 with a copy of the pooling "
                   "layer after it",
                   &end);
  }
};

int print_model(WhichOptions& o) {
  const engine::Truncation cut = parse_cut(o.end);
  o.request.end = cut.end;
  o.request.graft = cut.graft;
  const models::FoundModel found = models::find_model(o.request);
  for (const std::string& warning : found.warnings) warn(warning);
  std::cout << "network:   " << found.name << (found.trained ? "" : " (UNTRAINED)")
            << "\nprototxt:  " << found.prototxt.string()
            << "\nweights:   " << found.weights.string()
            << "\nfeature:   " << models::to_string(found.cut) << "\nmean BGR: ";
  for (const double value : found.mean_bgr) std::cout << " " << value;
  std::cout << "\n";
  return kOk;
}

Command which_command() {
  return {"which", "network that a command would use",
          "Prints the network that a command with the same options would use.",
          "  revisit models which\n  revisit models which --weights net/weights.caffemodel\n",
          with_options<WhichOptions>(print_model)};
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

struct RandomOptions {
  NetOptions made;
  std::string net = "alexnet";
  fs::path output;

  void declare(Options& options) {
    const std::vector<std::string>& known = models::trunk_names();
    options
        .option("net", joined(known, "|") + "|FILE", "network, or a prototxt (default alexnet)",
                &net)
        .suggest(known);
    declare_input_shape(options, &made.input_shapes);
    options.option("seed", "N", "seed of the weights (default 1)", &made.seed);
    options.option("output", "DIR", "folder of NET_random.prototxt and .caffemodel", &output, 'o')
        .required();
    options.flag("allow-unknown",
                 "warnings for unknown fields outside of layer parameters (default: errors)",
                 &made.allow_unknown);
    made.limits.declare(options);
  }
};

int write_random(RandomOptions& o) {
  const std::vector<std::string>& known = models::trunk_names();
  o.made.prototxt = o.net;
  const bool is_known = std::ranges::find(known, o.net) != known.end();
  if (is_known && !o.made.input_shapes.empty())
    throw UsageError("--input-shape: not with ", o.net, ", only with a prototxt");
  if (!is_known && !o.made.prototxt.has_extension() && !fs::exists(o.made.prototxt))
    throw UsageError("--net: expected a prototxt, ", joined(known, ", "), "; found '", o.net, "'",
                     nearest_name_hint(o.net, known));

  const models::ModelFiles files = is_known
                                       ? models::write_random_model(o.output, o.net, o.made.seed)
                                       : write_random_net(o.output, o.made);
  std::cout << files.prototxt.string() << "\n" << files.weights.string() << "\n";
  std::cerr << "untrained: random weights (seed " << o.made.seed
            << "); results do not measure accuracy\n";
  return kOk;
}

Command make_random_command() {
  return {"make-random", "untrained network with random weights",
          "Writes a network with random weights, for tests without a download: one of this "
          "project, or the inference layers of any prototxt. Weights are He-scaled, so that values "
          "keep their size from layer to layer. The network is not trained, so results do not "
          "measure accuracy. A seed gives the same files everywhere.",
          "  revisit models make-random -o /tmp/random\n"
          "  revisit models make-random --net vgg_cnn_s --seed 7 -o /tmp/random\n"
          "  revisit models make-random --net deploy.prototxt -o /tmp/random\n"
          "  revisit models make-random --net train_val.prototxt --input-shape 1,3,224,224 -o "
          "/tmp/random\n",
          with_options<RandomOptions>(write_random)};
}

}  // namespace

Command models_command() {
  return {"models",
          "known Caffe models: list, fetch, make-random",
          "Known Caffe models, and random ones.\n",
          "",
          {},
          {list_command(), fetch_command(), which_command(), make_random_command()}};
}

}  // namespace revisit::cli

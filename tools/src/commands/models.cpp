#include "models/models.h"

#include <iostream>

#include "cli/command.h"
#include "cli/net_options.h"
#include "cli/options.h"
#include "cli/terminal.h"
#include "revisit/base/text.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

constexpr double kMegabyte = 1e6;

std::string size_text(const models::CacheEntry& entry) {
  if (entry.state == models::CacheState::kAbsent) return "";
  return number(static_cast<double>(entry.size) / kMegabyte, 1) + " MB";
}

void print_found(const models::FoundModel& found) {
  for (const std::string& warning : found.warnings) warn(warning);
  std::cout << "network:   " << found.name << (found.trained ? "" : " (UNTRAINED)")
            << "\nprototxt:  " << found.prototxt.string()
            << "\nweights:   " << found.weights.string() << "\nfeature:   " << found.cut
            << "\nmean BGR:  " << joined(found.mean_bgr, " ") << "\n";
}

void print_known() {
  const fs::path cache = models::cache_folder();
  Table table({"model", "state", "size", "license", "input", "feature layers"});
  const auto loose = models::loose_weights(cache);
  for (const models::KnownModel& model : models::known_models()) {
    const models::CacheEntry entry = models::inspect(cache, model, loose);
    table.row({model.name, models::to_string(entry.state), size_text(entry), model.license,
               str(model.input_size), joined(model.cuts, " ")});
  }
  table.print(std::cout);
  std::cout << "\n";
  try {
    print_found(models::find_model({}));
  } catch (const Error&) {
    std::cout << "no network for commands without --model\n";
  }
  std::cout << "\ncache: " << cache.string() << "\n'revisit models fetch NAME' downloads one.\n";
}

struct ListOptions {
  std::optional<fs::path> model;

  void declare(Options& options) {
    options.argument("MODEL", &model).optional().suggest(models::known_model_names());
  }
};

int list_models(ListOptions& o) {
  if (!o.model) {
    print_known();
    return kOk;
  }
  const std::string name = o.model->string();
  const bool is_weights = name.ends_with(".caffemodel") || name.ends_with(".caffemodel.h5");
  print_found(models::find_model(is_weights ? models::ModelRequest{.weights = name}
                                            : models::ModelRequest{.model = name}));
  return kOk;
}

Command list_command() {
  return {"list", "known models and which are cached, or the files of a model",
          "Lists the known Caffe models, whether they are cached, and whether their checksums "
          "match. With MODEL (a known model, a prototxt, a caffemodel, or a folder of both) prints "
          "the network that a command with this --model would use. The cache is $REVISIT_MODELS or "
          "~/.cache/revisit/models.",
          "  revisit models list\n"
          "  revisit models list net/weights.caffemodel\n",
          with_options<ListOptions>(list_models)};
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
  std::cout << "license: " << model.license << "\n";
  if (!model.notes.empty()) std::cout << "notes: " << model.notes << "\n";
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

  void declare(Options& options) {
    options.argument("NAME", &name).suggest(models::known_model_names());
  }
};

int fetch_model(FetchOptions& o) {
  const models::KnownModel& model = models::known_model(o.name);
  print_fetched(model, models::fetch_model(model, models::cache_folder()));
  return kOk;
}

Command fetch_command() {
  return {"fetch", "download a model and check it",
          "Downloads a known model into the cache ($REVISIT_MODELS or ~/.cache/revisit/models) by "
          "the program curl, and checks its checksum. If interrupted, run the same command again "
          "to resume.",
          "  revisit models fetch bvlc_alexnet\n"
          "  REVISIT_MODELS=/data/models revisit models fetch squeezenet_v1.1\n",
          with_options<FetchOptions>(fetch_model)};
}

struct RandomOptions {
  NetOptions net{.prototxt = "alexnet"};
  fs::path output;

  void declare(Options& options) {
    const std::vector<std::string> known = models::own_net_names();
    options
        .option("net", joined(known, "|") + "|FILE", "network, or a prototxt (default alexnet)",
                &net.prototxt)
        .suggest(known);
    options.option("end", "LAYER", "last layer (default: the net's last)", &net.end);
    declare_input_shape(options, &net.input_shapes);
    options.option("seed", "N", "seed of the weights (default 1)", &net.seed);
    options.option("output", "DIR", "folder of NET_random.prototxt and .caffemodel", &output, 'o')
        .required();
    net.limits.declare(options);
  }
};

int write_random(RandomOptions& o) {
  const models::ModelFiles files = models::write_random_model(o.output, o.net);
  std::cout << files.prototxt.string() << "\n" << files.weights.string() << "\n";
  std::cerr << "untrained: random weights (seed " << o.net.seed
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
          "  revisit models make-random --net deploy.prototxt --end conv3 -o /tmp/random\n"
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
          {list_command(), fetch_command(), make_random_command()}};
}

}  // namespace revisit::cli

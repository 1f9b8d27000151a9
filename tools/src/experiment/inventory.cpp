#include "experiment/inventory.h"

#include <algorithm>
#include <fstream>

#include "cli/messages.h"
#include "eval/feature_options.h"
#include "models/cache.h"
#include "models/fetch.h"
#include "revisit/engine/net.h"
#include "revisit/weights_conversion/random_model.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

constexpr const char* kSequences[] = {"00", "05", "06", "08"};
/// Of the paper, and the stand-ins of random weights for them.
struct PaperNetwork {
  const char *name, *trunk;
};
constexpr PaperNetwork kPaperNetworks[] = {
    {"bvlc_alexnet", "alexnet"}, {"vgg_cnn_s", "vgg_cnn_s"}, {"places_cnds8", "places_cnds8"}};

void find_drives(const ExperimentOptions& options, Inventory& found) {
  FeatureOptions scans;
  scans.data = options.kitti;
  scans.every = options.every;
  for (const char* sequence : kSequences) {
    scans.sequence = sequence;
    try {
      found.drives.push_back(
          {sequence, static_cast<int64_t>(open_scans(scans, {.poses = true}).scans.size())});
      std::ifstream settings(options.kitti / "sequences" / sequence / "simulation.txt");
      for (std::string line; std::getline(settings, line);) {
        found.along_poses += line.starts_with("poses: ") ? 1 : 0;
        found.along_routes += line.starts_with("route: ") ? 1 : 0;
      }
    } catch (const InputError& error) {
      found.missing.push_back(str("sequence ", sequence, ": ", error.what()));
    }
  }
}

/// Numbers a scan, without reading weights.
int64_t feature_dim(const fs::path& prototxt, const models::Cut& cut,
                    const pipeline::ImageGeometry& geometry) {
  engine::LoadOptions load;
  load.truncation = {cut.end, cut.graft};
  load.allow_unknown = true;
  const engine::Net net = engine::Net::load_without_weights(prototxt, load);
  const engine::Port& input = net.inputs().at(0);
  const engine::Plan plan =
      net.plan({{input.name, engine::Shape{1, input.shape[1], geometry.height, geometry.width}}});
  return plan.outputs().at(0).shape.elements();
}

std::vector<models::Cut> usable_cuts(const models::FoundModel& model,
                                     const ExperimentOptions& options, Inventory& found) {
  std::vector<models::Cut> wanted{model.cut}, usable;
  for (const models::KnownModel& known : models::known_models())
    if (known.name == model.name) wanted = known.cuts;
  if (!model.trained) {
    for (const PaperNetwork& paper : kPaperNetworks)
      if (model.prototxt.filename().string().starts_with(paper.trunk))
        wanted = models::known_model(paper.name).cuts;
  }
  GeometryOptions image;
  image.sensor = options.sensor;
  if (options.width) image.width = options.width;
  for (const models::Cut& cut : wanted) {
    const int64_t dim = feature_dim(model.prototxt, cut, image.geometry());
    const double megabytes = static_cast<double>(dim) * sizeof(float) / 1e6;
    if (megabytes <= options.feature_mb)
      usable.push_back(cut);
    else
      found.missing.push_back(str(model.name, " ", models::to_string(cut), ": left out, ", dim,
                                  " numbers per scan are ", static_cast<int>(megabytes),
                                  " MB; --feature-mb allows more"));
  }
  return usable;
}

void add_network(const models::ModelRequest& request, const ExperimentOptions& options,
                 Inventory& found) {
  const models::FoundModel model = models::find_model(request);
  NetworkFound network{model.name, model.prototxt, model.weights, model.trained, {}};
  for (const NetworkFound& other : found.networks)
    if (other.name == network.name) return;  // the first one found
  network.cuts = usable_cuts(model, options, found);
  if (!network.cuts.empty()) found.networks.push_back(std::move(network));
}

/// Every caffemodel in the folders and their sub-folders.
void find_networks(const ExperimentOptions& options, Inventory& found) {
  std::vector<fs::path> folders = options.models;
  if (folders.empty()) folders.push_back(models::cache_folder());
  for (const fs::path& folder : folders) {
    std::error_code error;
    if (!options.models.empty() && !fs::is_directory(folder, error))
      throw UsageError(str("--models ", folder.string(), ": no such folder"));
    std::vector<fs::path> files;
    for (fs::recursive_directory_iterator entry(folder, error), end; !error && entry != end;
         entry.increment(error)) {
      const std::string name = entry->path().filename().string();
      if (name.ends_with(".caffemodel") || name.ends_with(".caffemodel.h5"))
        files.push_back(entry->path());
    }
    std::sort(files.begin(), files.end());
    for (const fs::path& weights : files) {
      try {
        models::ModelRequest request;
        request.weights = weights;
        add_network(request, options, found);
      } catch (const Error& unusable) {
        found.passed_over.push_back(str(weights.string(), ": ", message_of(unusable)));
      }
    }
  }
}

bool has_network(const Inventory& found, const PaperNetwork& wanted) {
  return std::any_of(found.networks.begin(), found.networks.end(), [&](const NetworkFound& n) {
    return n.name == wanted.name ||
           (!n.trained && n.prototxt.filename().string().starts_with(wanted.trunk));
  });
}

}  // namespace

const DriveFound* Inventory::drive(const std::string& sequence) const {
  for (const DriveFound& drive : drives)
    if (drive.sequence == sequence) return &drive;
  return nullptr;
}

Inventory take_inventory(const ExperimentOptions& options) {
  Inventory found;
  if (!options.kitti.empty()) find_drives(options, found);
  if (found.drives.empty() && !options.hkust) throw InputError(found.missing.front());
  find_networks(options, found);
  for (const PaperNetwork& wanted : kPaperNetworks) {
    if (has_network(found, wanted)) continue;
    const std::string advice = models::how_to_get(
        models::known_model(wanted.name),
        options.models.empty() ? models::cache_folder() : options.models.front());
    found.missing.push_back(str("network ", wanted.name, ": no weights; ", advice,
                                options.untrained ? "; random weights take its place" : ""));
    if (!options.untrained) continue;
    const models::ModelFiles files =
        models::write_random_model(options.output / "models", wanted.trunk, 1);
    models::ModelRequest request;
    request.model = files.prototxt;
    request.weights = files.weights;
    add_network(request, options, found);
  }
  const auto rank = [](const NetworkFound& network) {
    const auto& known = models::known_models();
    const auto at = std::find_if(known.begin(), known.end(),
                                 [&](const auto& model) { return model.name == network.name; });
    return std::pair(!network.trained, at - known.begin());
  };
  std::stable_sort(found.networks.begin(), found.networks.end(),
                   [&](const auto& a, const auto& b) { return rank(a) < rank(b); });
  return found;
}

}  // namespace revisit::cli

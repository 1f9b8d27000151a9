#include <google/protobuf/text_format.h>

#include <algorithm>
#include <iterator>
#include <sstream>

#include "experiment/experiment.h"
#include "experiments_table.h"
#include "models/all_models.h"
#include "models/cache.h"
#include "models/fetch.h"
#include "revisit/weights_conversion/random_model.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

void add(Arguments* to, const Arguments& more) {
  to->insert(to->end(), more.begin(), more.end());
}

/// A feature that a network gives.
struct NetworkFeature {
  std::string name;    // with its layers
  std::string prefix;  // of the labels of its curves and claims
  bool trained = true;
  Arguments arguments;
};

/// All features of each network, or the best of each trained one; without these, of the first.
std::vector<NetworkFeature> features_of(const std::vector<models::FoundModel>& networks, bool all) {
  std::vector<NetworkFeature> features;
  for (const models::FoundModel& network : networks) {
    if (!all && !network.trained && !features.empty()) break;
    const models::KnownModel* known = models::known_model_of(network);
    for (const models::Cut& cut : known ? known->cuts : std::vector{network.cut}) {
      NetworkFeature& feature = features.emplace_back();
      feature.name = network.name + " " + models::to_string(cut);
      if (!network.trained) feature.name += " (UNTRAINED)";
      feature.trained = network.trained;
      feature.arguments = {"--model",   network.prototxt.string(),
                           "--weights", network.weights.string(),
                           "--end",     cut.end};
      if (!cut.graft.empty()) add(&feature.arguments, {"--graft", cut.graft});
      if (!all) break;
    }
  }
  for (NetworkFeature& feature : features)
    feature.prefix = all ? feature.name : features.size() > 1 ? feature.name + ", " : "";
  return features;
}

/// Plans the runs of one experiment.
class Planner {
 public:
  Planner(const reports::PlannedExperiment& experiment, const ExperimentOptions& options,
          const Networks& networks)
      : experiment_(experiment),
        options_(options),
        features_(features_of(networks.found, experiment.every_layer())) {
    plan_.report = experiment.report();
    plan_.report.set_version(REVISIT_VERSION);
    plan_.report.set_simulated(
        std::ranges::any_of(experiment.sequences(), [&](const std::string& sequence) {
          return fs::exists(options.shared.data / "sequences" / sequence / "simulation.txt");
        }));
    add_notes(networks.missing);
    smallest_ = *experiment.sequences().rbegin();
    if (!fs::exists(options.shared.data / "sequences" / smallest_))
      for (const std::string& sequence : experiment.sequences())
        if (fs::exists(options.shared.data / "sequences" / sequence)) smallest_ = sequence;
    for (const std::string& sequence : experiment.sequences()) add_runs(sequence);
    for (const reports::PlannedClaim& claim : experiment.claim())
      for (const NetworkFeature& feature : features_) add_claim(claim, feature.prefix);
  }

  const Plan& plan() const { return plan_; }

 private:
  void add_notes(const std::vector<std::string>& missing) {
    const auto add = [&](const std::string& note) { plan_.report.add_notes(note); };
    if (experiment_.every_layer())
      std::ranges::for_each(missing, add);
    else if (features_.size() == 1)
      add("Feature: " + features_.front().name + ".");
    if (plan_.report.simulated()) add("Simulated drives: figures are not those of KITTI.");
    if (features_.empty())
      add("No network was found: give --models DIR, or --untrained to see the machinery work.");
    else if (!features_.front().trained)
      add("UNTRAINED: the networks have random weights; figures say nothing about the method.");
  }

  void add_runs(const std::string& sequence) {
    for (const NetworkFeature& feature : features_)
      for (const reports::PlannedCurve& curve : experiment_.curve())
        if (curve.feature().empty()) add_run(sequence, curve, &feature);
    for (const reports::PlannedCurve& curve : experiment_.curve())
      if (!curve.feature().empty()) add_run(sequence, curve, nullptr);
  }

  void add_run(const std::string& sequence, const reports::PlannedCurve& curve,
               const NetworkFeature* network) {
    reports::ExperimentRun& run = *plan_.report.add_runs();
    run.set_panel(sequence);
    run.set_label(network ? network->prefix + curve.label() : curve.label());
    run.set_feature(network ? "cnn" : curve.feature());
    if (curve.has_method()) *run.mutable_method() = curve.method();
    Arguments& arguments = plan_.arguments.emplace_back();
    const FeatureOptions& shared = options_.shared;
    if (!experiment_.places()) {
      arguments = {shared.data.string(), "--sequence", sequence,           "--every",
                   str(shared.every),    "--sensor",   shared.image.sensor};
      if (shared.data.empty())
        run.set_reason("no drives: give --kitti DIR");
      else if (experiment_.every_layer() && network && !network->trained && sequence != smallest_)
        run.set_reason("random weights prove nothing: run on sequence " + smallest_ +
                       " alone, to show that the network runs");
    } else if (options_.hkust) {
      arguments = {options_.hkust->string(), "--sequence", sequence, "--sensor", "vlp16"};
    } else {
      run.set_reason("no set of places: give --hkust DIR with " + sequence + "/");
    }
    run.set_state(run.reason().empty() ? "to do" : "skipped");
    if (shared.image.width) add(&arguments, {"--width", str(*shared.image.width)});
    add(&arguments, network ? network->arguments : Arguments{"--feature", run.feature()});
    std::istringstream words(experiment_.options() + " " + curve.options());
    add(&arguments, {std::istream_iterator<std::string>(words), {}});
  }

  void add_claim(reports::PlannedClaim claim, const std::string& prefix) {
    const auto is_of_network = [&](const std::string& label) {
      return std::ranges::any_of(experiment_.curve(), [&](const reports::PlannedCurve& curve) {
        return curve.label() == label && curve.feature().empty();
      });
    };
    if (claim.text().empty()) claim.set_text(claim.better() + " is better than " + claim.worse());
    if (!experiment_.every_layer()) claim.set_text(prefix + claim.text());
    claim.set_better(prefix + claim.better());
    if (is_of_network(claim.worse())) claim.set_worse(prefix + claim.worse());
    plan_.claims.push_back(claim);
  }

  const reports::PlannedExperiment& experiment_;
  const ExperimentOptions& options_;
  const std::vector<NetworkFeature> features_;
  std::string smallest_;  // sequence that is there, as far as the table knows
  Plan plan_;
};

}  // namespace

const reports::ExperimentTable& experiment_table() {
  static const reports::ExperimentTable table = [] {
    reports::ExperimentTable read;
    if (!google::protobuf::TextFormat::ParseFromString(kExperimentsTable, &read))
      throw Error("experiments.txtpb cannot be read");
    return read;
  }();
  return table;
}

Networks find_networks(const ExperimentOptions& options) {
  std::vector<fs::path> folders = options.models;
  for (const fs::path& folder : folders)
    if (!fs::is_directory(folder))
      throw UsageError(str("--models ", folder.string(), ": no such folder"));
  if (folders.empty()) folders.push_back(models::cache_folder());
  Networks networks;
  networks.found = models::all_models(folders, &networks.passed_over);
  for (const char* name : {"bvlc_alexnet", "vgg_cnn_s", "places_cnds8"}) {
    const models::KnownModel& wanted = models::known_model(name);
    if (std::ranges::count(networks.found, &wanted, models::known_model_of)) continue;
    networks.missing.push_back(str("network ", name, ": no weights; ",
                                   models::how_to_get(wanted, folders.front()),
                                   options.untrained ? "; random weights take its place" : ""));
    if (!options.untrained) continue;
    const auto files = models::write_random_model(options.output / "models", wanted.trunk, 1);
    networks.found.push_back(models::find_model({files.prototxt, files.weights}));
  }
  return networks;
}

std::vector<Plan> make_plans(const ExperimentOptions& options, const Networks& networks) {
  std::vector<Plan> plans;
  for (const reports::PlannedExperiment& experiment : experiment_table().experiment())
    if (std::ranges::any_of(options.names, [&](const std::string& name) {
          return name == "all" || name == experiment.report().name();
        }))
      plans.push_back(Planner(experiment, options, networks).plan());
  return plans;
}

}  // namespace revisit::cli

#include "experiment/plan.h"

#include <algorithm>
#include <functional>

#include "models/find_model.h"
#include "revisit/base/error.h"

namespace revisit::cli {
namespace {

void add(Arguments& to, const Arguments& more) {
  to.insert(to.end(), more.begin(), more.end());
}

Arguments feature_of(const NetworkFound& network, const models::Cut& cut) {
  Arguments arguments = {"--model",   network.prototxt.string(),
                         "--weights", network.weights.string(),
                         "--end",     cut.end};
  if (!cut.graft.empty()) add(arguments, {"--graft", cut.graft});
  return arguments;
}

std::string label_of(const NetworkFound& network, const models::Cut& cut) {
  return network.name + " " + models::to_string(cut) + (network.trained ? "" : " (UNTRAINED)");
}

class Planner {
 public:
  Planner(const ExperimentOptions& options, const Inventory& inventory)
      : options_(options), inventory_(inventory) {
    for (const NetworkFound& network : inventory.networks)
      if (network.trained) best_.push_back(&network);
    if (best_.empty() && !inventory.networks.empty()) best_.push_back(&inventory.networks.front());
  }

  ExperimentPlan plan(const ExperimentInfo& info) const {
    ExperimentPlan plan{&info, {}, {}, {}};
    for (const std::string& sequence : info.sequences) {
      if (info.every_layer) add_layers(plan, sequence);
      for_best([&](const Arguments& feature, const std::string& prefix) {
        for (const CurveInfo& curve : info.curves)
          if (curve.feature == "cnn") add_run(plan, sequence, curve, feature, prefix);
      });
      for (const CurveInfo& curve : info.curves)
        if (curve.feature != "cnn")
          add_run(plan, sequence, curve, {"--feature", curve.feature}, "");
    }
    for (const Claim& claim : info.claims) {
      if (!info.every_layer)
        for_best([&](const Arguments&, const std::string& prefix) {
          plan.claims.push_back(
              {prefix + claim.text, prefix + claim.better, prefix + claim.worse, claim.slack});
        });
      else
        for (const NetworkFound* network : best_)
          for (const models::Cut& cut : network->cuts)
            plan.claims.push_back({claim.text, label_of(*network, cut), claim.worse, claim.slack});
    }
    add_notes(plan);
    return plan;
  }

 private:
  /// `make(feature, prefix)` for the best layer of each trained network; the prefix tells them
  /// apart where there are several.
  void for_best(const std::function<void(const Arguments&, const std::string&)>& make) const {
    for (const NetworkFound* network : best_)
      make(feature_of(*network, network->cuts.front()),
           best_.size() > 1 ? label_of(*network, network->cuts.front()) + ", " : "");
  }

  /// A curve, on a sequence that is there or not.
  void add_run(ExperimentPlan& plan, const std::string& sequence, const CurveInfo& curve,
               const Arguments& feature, const std::string& prefix) const {
    PlannedRun& run = plan.runs.emplace_back();
    run.panel = sequence;
    run.curve = curve;
    run.curve.label = prefix + curve.label;
    if (!plan.info->places) {
      run.arguments = {options_.kitti.string(), "--sequence", sequence,       "--every",
                       str(options_.every),     "--sensor",   options_.sensor};
      if (options_.kitti.empty())
        run.skipped = "no drives: give --kitti DIR";
      else if (!inventory_.drive(sequence))
        run.skipped = "sequence " + sequence + " is not there";
    } else if (options_.hkust) {
      run.arguments = {options_.hkust->string(), "--sequence", sequence, "--sensor", "vlp16"};
    } else {
      run.skipped = "no set of places: give --hkust DIR with " + sequence + "/";
    }
    if (options_.width) add(run.arguments, {"--width", str(options_.width)});
    add(run.arguments, feature);
    add(run.arguments, curve.options);
  }

  void add_layers(ExperimentPlan& plan, const std::string& sequence) const {
    CurveInfo curve;
    curve.options = plan.info->curves.front().options;
    for (const NetworkFound& network : inventory_.networks)
      for (const models::Cut& cut : network.cuts) {
        curve.label = label_of(network, cut);
        add_run(plan, sequence, curve, feature_of(network, cut), "");
        if (!network.trained && sequence != smallest() && plan.runs.back().skipped.empty())
          plan.runs.back().skipped = "random weights prove nothing: run on sequence " + smallest() +
                                     " alone, to show that the network runs";
      }
  }

  void add_notes(ExperimentPlan& plan) const {
    if (plan.info->every_layer)
      plan.notes = inventory_.missing;
    else if (best_.size() == 1)
      plan.notes.push_back("Feature: " + label_of(*best_.front(), best_.front()->cuts.front()) +
                           ".");
    if (!plan.info->note.empty()) plan.notes.push_back(plan.info->note);
    if (inventory_.along_poses + inventory_.along_routes > 0 && !plan.info->places)
      plan.notes.push_back(str("Simulated drives",
                               inventory_.along_routes == 0  ? " along the real poses"
                               : inventory_.along_poses == 0 ? " along generated routes"
                                                             : "",
                               ": figures are not those of KITTI."));
    if (best_.empty())
      plan.notes.push_back(
          "No network was found: give --models DIR, or --untrained to see the "
          "machinery work.");
    else if (!best_.front()->trained)
      plan.notes.push_back(
          "UNTRAINED: the networks have random weights; figures say nothing about the method.");
  }

  std::string smallest() const {
    const auto least = std::ranges::min_element(inventory_.drives, {}, [](const DriveFound& drive) {
      return std::pair(drive.sequence == "08", drive.scans);
    });
    return least == inventory_.drives.end() ? "" : least->sequence;
  }

  const ExperimentOptions& options_;
  const Inventory& inventory_;
  std::vector<const NetworkFound*> best_;
};

}  // namespace

std::vector<ExperimentPlan> make_plans(const ExperimentOptions& options,
                                       const Inventory& inventory) {
  const Planner planner(options, inventory);
  std::vector<ExperimentPlan> plans;
  for (const ExperimentInfo& info : experiments()) {
    const auto wanted = [&](const std::string& name) { return name == "all" || name == info.name; };
    if (std::ranges::any_of(options.names, wanted)) plans.push_back(planner.plan(info));
  }
  return plans;
}

}  // namespace revisit::cli

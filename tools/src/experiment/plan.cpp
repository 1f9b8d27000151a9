#include "experiment/plan.h"

#include <algorithm>
#include <filesystem>
#include <functional>
#include <map>

#include "models/find_model.h"
#include "revisit/proto/error.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

constexpr int kDimensions[] = {0, 400, 200, 100, 50};  // 0: all; first, as it serves the others
constexpr int kStoredParts[] = {3, 6, 10};

class Planner {
 public:
  Planner(const ExperimentOptions& options, const Inventory& inventory)
      : options_(options), inventory_(inventory) {
    for (const NetworkFound& network : inventory.networks)
      if (network.trained) best_.push_back(&network);
    if (best_.empty() && !inventory.networks.empty()) best_.push_back(&inventory.networks.front());
  }

  ExperimentPlan plan(const ExperimentInfo& info) const {
    static const std::map<std::string, void (Planner::*)(ExperimentPlan&) const> makers = {
        {"networks-and-layers", &Planner::networks}, {"easy-vs-median", &Planner::easy},
        {"alignment", &Planner::alignment},          {"score", &Planner::score},
        {"pca-dimensions", &Planner::dimensions},    {"bidirectional", &Planner::bidirectional},
        {"comparison", &Planner::comparison},        {"hkust-rotation", &Planner::rotation},
        {"hkust-objects", &Planner::objects}};
    ExperimentPlan plan{&info, {}, {}, {}};
    (this->*makers.at(info.name))(plan);
    if (inventory_.along_poses + inventory_.along_routes > 0 && !info.name.starts_with("hkust"))
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
    return plan;
  }

 private:
  using Extra = Arguments;

  Arguments common(const std::string& sequence) const {
    Arguments arguments = {options_.kitti.string(), "--sequence", sequence,       "--every",
                           str(options_.every),     "--sensor",   options_.sensor};
    add(arguments, width());
    return arguments;
  }
  Extra width() const { return options_.width ? Extra{"--width", str(options_.width)} : Extra{}; }
  static void add(Arguments& to, const Extra& more) {
    to.insert(to.end(), more.begin(), more.end());
  }

  static Extra feature_of(const NetworkFound& network, const models::Cut& cut) {
    Extra extra = {"--model",   network.prototxt.string(),
                   "--weights", network.weights.string(),
                   "--end",     cut.end};
    if (!cut.graft.empty()) add(extra, {"--graft", cut.graft});
    return extra;
  }
  static std::string label_of(const NetworkFound& network, const models::Cut& cut) {
    return network.name + " " + models::to_string(cut) + (network.trained ? "" : " (UNTRAINED)");
  }

  /// A curve, on a sequence that is there or not.
  void run(ExperimentPlan& plan, const std::string& sequence, const std::string& label,
           std::initializer_list<Extra> extras, const std::string& feature = "cnn") const {
    PlannedRun planned{sequence, label, common(sequence), feature, ""};
    for (const Extra& extra : extras) add(planned.arguments, extra);
    if (options_.kitti.empty())
      planned.skipped = "no drives: give --kitti DIR";
    else if (!inventory_.drive(sequence))
      planned.skipped = "sequence " + sequence + " is not there";
    plan.runs.push_back(std::move(planned));
  }

  /// `make(network, cut, prefix)` for the best feature of each trained network; the prefix tells
  /// them apart where there are several.
  void for_best(const std::function<void(const Extra&, const std::string&)>& make) const {
    for (const NetworkFound* network : best_)
      make(feature_of(*network, network->cuts.front()),
           best_.size() > 1 ? label_of(*network, network->cuts.front()) + ", " : "");
  }

  /// Claims that hold for every one of the best features.
  void claim(ExperimentPlan& plan, const std::string& text, const std::string& better,
             const std::string& worse, double slack = 0) const {
    for_best([&](const Extra&, const std::string& prefix) {
      plan.claims.push_back({prefix + text, prefix + better, prefix + worse, slack});
    });
  }

  void name_feature(ExperimentPlan& plan) const {
    if (best_.size() == 1)
      plan.notes.push_back("Feature: " + label_of(*best_.front(), best_.front()->cuts.front()) +
                           ".");
  }

  void networks(ExperimentPlan& plan) const {
    for (const char* sequence : {"00", "05", "06"}) {
      for (const NetworkFound& network : inventory_.networks)
        for (const models::Cut& cut : network.cuts) {
          run(plan, sequence, label_of(network, cut),
              {feature_of(network, cut), {"--protocol", "paper-median"}});
          PlannedRun& planned = plan.runs.back();
          if (!network.trained && sequence != smallest() && planned.skipped.empty())
            planned.skipped = "random weights prove nothing: run on sequence " + smallest() +
                              " alone, to show that the network runs";
        }
      run(plan, sequence, "data", {{"--feature", "data"}, {"--protocol", "paper-median"}}, "data");
    }
    for (const NetworkFound* network : best_)
      for (const models::Cut& cut : network->cuts)
        plan.claims.push_back(
            {"the CNN feature is better than the range image", label_of(*network, cut), "data", 0});
    plan.notes.insert(plan.notes.end(), inventory_.missing.begin(), inventory_.missing.end());
  }

  void easy(ExperimentPlan& plan) const {
    for (const char* sequence : {"00", "05", "06"})
      for_best([&](const Extra& feature, const std::string& prefix) {
        run(plan, sequence, prefix + "easy", {feature, {"--protocol", "paper-easy"}});
        run(plan, sequence, prefix + "median", {feature, {"--protocol", "paper-median"}});
      });
    claim(plan, "easy is better than median (the paper: on 00 and 05, not on 06)", "easy",
          "median");
    name_feature(plan);
  }

  void alignment(ExperimentPlan& plan) const {
    const Extra median = {"--protocol", "paper-median"};
    for (const char* sequence : {"00", "05", "06"}) {
      for_best([&](const Extra& feature, const std::string& prefix) {
        run(plan, sequence, prefix + "aligned", {feature, median});
        run(plan, sequence, prefix + "not aligned", {feature, median, {"--align", "none"}});
      });
      run(plan, sequence, "data, aligned", {{"--feature", "data"}, median}, "data");
      run(plan, sequence, "data, not aligned", {{"--feature", "data"}, median, {"--align", "none"}},
          "data");
    }
    claim(plan, "aligned is better than not aligned", "aligned", "not aligned");
    name_feature(plan);
  }

  void score(ExperimentPlan& plan) const {
    const Extra median = {"--protocol", "paper-median"};
    for (const char* sequence : {"00", "05", "06"})
      for_best([&](const Extra& feature, const std::string& prefix) {
        run(plan, sequence, prefix + "s = 2 c1 - c4", {feature, median});
        run(plan, sequence, prefix + "cosine", {feature, median, {"--score", "cosine"}});
      });
    claim(plan, "s is not worse than the cosine (by more than 0.005)", "s = 2 c1 - c4", "cosine",
          0.005);
    name_feature(plan);
  }

  void dimensions(ExperimentPlan& plan) const {
    const Extra median = {"--protocol", "paper-median"};
    const auto label = [](int k) {
      return k ? str(k, " dimensions") : std::string("all dimensions");
    };
    for (const char* sequence : {"00", "05", "06"})
      for_best([&](const Extra& feature, const std::string& prefix) {
        for (const int k : kDimensions)
          run(plan, sequence, prefix + label(k), {feature, median, {"--pca", str(k)}});
      });
    for (const int k : {400, 200})
      claim(plan, label(k) + " are as good as all (within 0.02)", label(k), label(0), 0.02);
    name_feature(plan);
  }

  void bidirectional(ExperimentPlan& plan) const {
    for_best([&](const Extra& feature, const std::string& prefix) {
      for (const auto& [which, label] :
           {std::pair("1", "case 1"), {"2", "case 2"}, {"both", "both cases"}})
        run(plan, "08", prefix + label,
            {feature, {"--protocol", "paper-difficult", "--query-case", which}});
    });
    claim(plan, "both cases are better than case 1 alone", "both cases", "case 1");
    claim(plan, "both cases are better than case 2 alone", "both cases", "case 2");
    name_feature(plan);
  }

  void comparison(ExperimentPlan& plan) const {
    const Extra median = {"--protocol", "paper-median"};
    for (const char* sequence : {"00", "05", "06"})
      for (const PaperMethod& method : paper_methods()) {
        if (method.feature != "cnn") {
          run(plan, sequence, method.method, {{"--feature", method.feature}, median},
              method.feature);
          continue;
        }
        for_best([&](const Extra& feature, const std::string& prefix) {
          run(plan, sequence, prefix + method.method, {feature, median});
        });
      }
    for (const PaperMethod& method : paper_methods())
      if (method.in_paper && method.feature != "cnn")
        claim(plan, "proposed is better than " + method.method, "proposed", method.method);
    name_feature(plan);
  }

  /// How queries are described, beside the default.
  using Way = std::pair<std::string, Extra>;

  void places(ExperimentPlan& plan, const std::string& set, const std::vector<Way>& ways) const {
    for_best([&](const Extra& feature, const std::string& prefix) {
      for (const int part : kStoredParts)
        for (const auto& [way, extra] : ways) {
          PlannedRun planned{set, prefix + stored(part) + way, {}, "cnn", ""};
          if (options_.hkust) {
            planned.arguments = {
                options_.hkust->string(), "--sequence", set, "--sensor", "vlp16", "--protocol",
                str("places-", part)};
            add(planned.arguments, width());
            add(planned.arguments, feature);
            add(planned.arguments, extra);
          } else {
            planned.skipped = "no set of places: give --hkust DIR with " + set + "/";
          }
          plan.runs.push_back(std::move(planned));
        }
    });
    name_feature(plan);
  }
  static std::string stored(int part) { return str("1/", part, " stored"); }

  void rotation(ExperimentPlan& plan) const {
    places(plan, "rotation",
           {{"", {}},
            {", both cases", {"--query-case", "both"}},
            {", not aligned", {"--align", "none"}}});
    for (const int part : kStoredParts) {
      claim(plan, "aligned is better than not aligned", stored(part),
            stored(part) + ", not aligned");
      claim(plan, "both cases are better than case 1 alone", stored(part) + ", both cases",
            stored(part));
    }
    plan.notes.push_back(
        "The sensor is turned all the way round, so that for about half of the pairs the principal "
        "direction has the opposite sign: queries in both cases are shown, too.");
  }
  void objects(ExperimentPlan& plan) const { places(plan, "objects", {{"", {}}}); }

  std::string smallest() const {
    const auto least = std::min_element(
        inventory_.drives.begin(), inventory_.drives.end(), [](const auto& a, const auto& b) {
          return std::pair(a.sequence == "08", a.scans) < std::pair(b.sequence == "08", b.scans);
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
    if (std::any_of(options.names.begin(), options.names.end(), wanted))
      plans.push_back(planner.plan(info));
  }
  return plans;
}

}  // namespace revisit::cli

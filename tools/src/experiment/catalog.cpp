#include "experiment/catalog.h"

#include <yaml-cpp/yaml.h>

#include <sstream>

#include "experiments_yaml.h"
#include "revisit/base/error.h"

namespace revisit::cli {
namespace {

std::string text(const YAML::Node& entry, const char* key) {
  return entry[key].as<std::string>("");
}

Arguments words(const std::string& options) {
  std::istringstream stream(options);
  Arguments words;
  for (std::string word; stream >> word;) words.push_back(word);
  return words;
}

CurveInfo curve_of(const YAML::Node& entry, const std::string& common_options) {
  CurveInfo curve;
  curve.label = text(entry, "label");
  curve.feature = entry["feature"].as<std::string>(curve.feature);
  curve.options = words(common_options + " " + text(entry, "options"));
  curve.needs_training = entry["training"].as<bool>(false);
  if (entry["parameters"]) curve.parameters = text(entry, "parameters");
  if (entry["fps"]) curve.paper_frames_per_second = entry["fps"].as<double>();
  return curve;
}

ExperimentInfo experiment_of(const YAML::Node& entry) {
  ExperimentInfo info;
  info.name = text(entry, "name");
  info.title = text(entry, "title");
  info.question = text(entry, "question");
  info.paper = text(entry, "paper");
  info.note = text(entry, "note");
  info.places = entry["places"].IsDefined();
  info.sequences = info.places ? std::vector{text(entry, "places")}
                               : entry["sequences"].as<std::vector<std::string>>();
  info.every_layer = entry["every-layer"].as<bool>(false);
  for (const YAML::Node& curve : entry["curves"])
    info.curves.push_back(curve_of(curve, text(entry, "options")));
  for (const YAML::Node& claim : entry["claims"])
    info.claims.push_back({text(claim, "text"), text(claim, "better"), text(claim, "worse"),
                           claim["slack"].as<double>(0)});
  return info;
}

}  // namespace

const std::vector<ExperimentInfo>& experiments() {
  static const std::vector<ExperimentInfo> all = [] {
    std::vector<ExperimentInfo> infos;
    for (const YAML::Node& entry : YAML::Load(kExperimentsYaml))
      infos.push_back(experiment_of(entry));
    return infos;
  }();
  return all;
}

const ExperimentInfo& find_experiment(const std::string& name) {
  std::vector<std::string> names = {"all", "list"};
  for (const ExperimentInfo& info : experiments()) {
    if (info.name == name) return info;
    names.push_back(info.name);
  }
  throw UsageError(str("unknown experiment '", name, "'", did_you_mean(name, names),
                       "; 'revisit experiment list' shows them all"));
}

}  // namespace revisit::cli

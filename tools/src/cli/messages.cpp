#include "cli/messages.h"

#include <iostream>
#include <string_view>

namespace revisit::cli {
namespace {

constexpr Setting kSettings[] = {
    {"DescribeOptions::align", "--align"},
    {"DescribeOptions::strict", "--strict"},
    {"Distance::kPlace", "--distance place"},
    {"EvaluationOptions::protocols", "--protocol"},
    {"EvaluationOptions::query_case", "--query-case"},
    {"LearnRingOptions::lesson", "--from"},
    {"Limits::layers", "--max-layers"},
    {"Limits::text_bytes", "--max-text-mb"},
    {"Limits::weight_bytes", "--max-weights-mb"},
    {"LoadOptions::allow_missing", "--allow-missing"},
    {"LoadOptions::inputs", "--input-shape"},
    {"Net::layer_names", "'revisit net inspect'"},
    {"PlanOptions::max_run_bytes", "--max-run-mb"},
    {"RecognizerOptions::first_stretch", "--first-stretch"},
    {"RecognizerOptions::graph_candidates", "--graph-candidates"},
    {"RecognizerOptions::k", "--k"},
    {"RecognizerOptions::precision", "--sure"},
    {"ReductionOptions::memory_gb", "--memory"},
    {"RingOptions::adapt", "--ring-adapt"},
    {"RingOptions::key_candidates", "--ring-key-candidates"},
    {"RingOptions::numbers", "--ring-numbers"},
    {"RingRecipe::layers", "--layers"},
    {"RobustnessOptions::alterations", "--alter"},
    {"RobustnessOptions::both_cases", "--query-case both"},
    {"RobustnessOptions::queries", "--queries"},
    {"RobustnessOptions::rule", "--radius"},
    {"SensorMount::height", "--sensor-height"},
    {"SensorMount::pitch", "--sensor-pitch"},
    {"SensorMount::roll", "--sensor-roll"},
    {"SimulationConfig::every", "--every"},
    {"SimulationConfig::last_frame", "--frames"},
    {"SimulationConfig::output", "--output"},
    {"SimulationConfig::overwrite", "--overwrite"},
    {"SimulationConfig::sequence", "--sequence"},
    {"SimulationConfig::traffic", "--traffic"},
    {"Truncation::end", "--end"},
    {"Truncation::graft", "--graft"},
    {"engine::layer_types", "'revisit net layers'"},
    {"models::known_models", "'revisit models list'"},
    {"pipeline::learn_ring_model", "'revisit learn'"},
};

}  // namespace

std::span<const Setting> settings_in_messages() {
  return kSettings;
}

std::string in_our_words(std::string message) {
  for (const auto& [field, here] : kSettings) {
    const std::string_view name = field, ours = here;
    for (size_t at = message.find(name); at != std::string::npos;
         at = message.find(name, at + ours.size()))
      message.replace(at, name.size(), ours);
  }
  return message;
}

void note(const std::string& message) {
  std::cerr << "note: " << in_our_words(message) << "\n";
}

void warn(const std::string& message) {
  std::cerr << "warning: " << in_our_words(message) << "\n";
}

void warn_left_out(const std::string& why) {
  warn(why + "; this scan is left out");
}

}  // namespace revisit::cli

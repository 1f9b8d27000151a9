#include "cli/messages.h"

#include <algorithm>
#include <iostream>

namespace revisit::cli {
namespace {

constexpr ProgramName kNames[] = {
    {"DescribeOptions::align", "--align"},
    {"Distance::kPlace", "--distance place"},
    {"EvaluationOptions::false_beyond", "--negative-radius"},
    {"EvaluationOptions::query_case", "--query-case"},
    {"Limits::layers", "--max-layers"},
    {"Limits::text_bytes", "--max-text-mb"},
    {"Limits::weight_bytes", "--max-weights-mb"},
    {"LoadOptions::allow_missing", "--allow-missing"},
    {"LoadOptions::inputs", "--input-shape"},
    {"LoopDetectorOptions::local_map", "--local-map"},
    {"LoopDetectorOptions::verify", "--verify"},
    {"NetReadOptions::allow_unknown_fields", "--allow-unknown"},
    {"Net::layer_names", "'revisit net inspect'"},
    {"PlanOptions::max_run_bytes", "--max-run-mb"},
    {"ReductionOptions::memory_gb", "--memory"},
    {"SimulationConfig::overwrite", "--overwrite"},
    {"Truncation::end", "--end"},
    {"Truncation::graft", "--graft"},
    {"engine::layer_types", "'revisit net layers'"},
    {"models::known_models", "'revisit models list'"},
    {"learn_ring_model", "'revisit train'"},
};

}  // namespace

std::span<const ProgramName> names_in_messages() {
  return kNames;
}

std::string message_of(const Error& error) {
  return error.message([](const std::string& name) -> std::string {
    const auto* const found = std::ranges::find(kNames, name, &ProgramName::cpp);
    return found == std::end(kNames) ? name : found->here;
  });
}

void note(const std::string& message) {
  std::cerr << "note: " << message << "\n";
}

void warn(const std::string& message) {
  std::cerr << "warning: " << message << "\n";
}

void warn_skipped(const std::string& why) {
  warn(why + "; the scan is skipped");
}

}  // namespace revisit::cli

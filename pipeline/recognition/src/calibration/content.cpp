#include "calibration/content.h"

#include <cmath>

#include "revisit/base/error.h"

namespace revisit {

void fill(const Calibration& from, ring::Calibration& to) {
  to.set_k(from.k);
  to.set_score(name_of(from.score));
  to.set_radius(from.radius);
  to.set_wrong_beyond(from.incorrect_beyond);
  to.set_learnt_from(from.trained_on);
  for (const CalibrationBlock& block : from.blocks) {
    ring::CalibrationBlock& written = *to.add_blocks();
    written.set_lowest(block.lowest);
    written.set_matches(block.matches);
    written.set_right(block.correct);
  }
}

Calibration calibration_from(const ring::Calibration& from, const std::string& name) {
  const auto expect = [&](bool ok, const std::string& what) {
    if (!ok) throw InputError(name + ": not a usable calibration: " + what);
  };
  Calibration to;
  to.k = from.k();
  expect(to.k >= 1, str("k is ", to.k));
  try {
    to.score = parse_score(from.score());
  } catch (const UsageError& error) {
    expect(false, error.what());
  }
  to.radius = from.radius();
  to.incorrect_beyond = from.wrong_beyond();
  to.trained_on = from.learnt_from();
  expect(from.blocks_size() > 0, "it has no blocks");
  for (const ring::CalibrationBlock& block : from.blocks()) {
    expect(std::isfinite(block.lowest()) &&
               (to.blocks.empty() || to.blocks.back().lowest < block.lowest()),
           "its scores do not ascend");
    // These conditions are false for NaN.
    expect(block.matches() > 0 && std::isfinite(block.matches()) && block.right() >= 0 &&
               block.right() <= block.matches(),
           str(block.right(), " of ", block.matches(), " matches are correct"));
    to.blocks.push_back({block.lowest(), block.matches(), block.right()});
  }
  for (size_t i = 1; i < to.blocks.size(); ++i)
    expect(to.probability(to.blocks[i - 1].lowest) <= to.probability(to.blocks[i].lowest),
           "a higher score has a lower probability");
  return to;
}

std::string calibration_content(const Calibration& calibration) {
  ring::Calibration message;
  fill(calibration, message);
  return message.SerializeAsString();
}

Calibration parse_calibration(std::string_view content, const std::string& name) {
  ring::Calibration message;
  if (!message.ParseFromArray(content.data(), static_cast<int>(content.size())))
    throw InputError(name + ": not a usable calibration: it is another kind of data, or truncated");
  return calibration_from(message, name);
}

}  // namespace revisit

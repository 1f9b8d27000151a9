#include "revisit/loops/loop_summary.h"

#include <algorithm>
#include <cmath>

#include "revisit/base/error.h"
#include "revisit/base/text.h"

namespace revisit {

void LoopSummary::add(const Detection& found) {
  ++scans_;
  skipped_ += found.error.empty() ? 0 : 1;
  if (!found.loop) return;
  best_ = queried_++ == 0 ? found.loop->score : std::max(best_, found.loop->score);
  accepted_ += found.loop->accepted ? 1 : 0;
  const bool by_score = threshold_ && found.loop->score >= *threshold_;
  few_places_ += found.rejection == Rejection::kScore && by_score ? 1 : 0;
  ++rejected_[found.rejection];
}

std::string LoopSummary::text() const {
  const auto rounded = [](double score) { return exact(std::round(score * 1000) / 1000); };
  std::string text = str(scans_, " scans, ", accepted_, " loops accepted");
  if (accepted_ == 0 && queried_ == 0)
    text += str(": no scan had a candidate (exclusion ", to_string(exclusion_), ")");
  else if (accepted_ == 0 && threshold_)
    text += str(": the best score of ", queried_, " queries is ", rounded(best_), " (threshold ",
                rounded(*threshold_), "); ", scans_ - skipped_ - queried_,
                " scans had no candidate (exclusion ", to_string(exclusion_), ")");
  const auto refused = [&](Rejection why) {
    const auto found = rejected_.find(why);
    return found == rejected_.end() ? 0 : found->second;
  };
  for (const auto& [n, why] :
       {std::pair(few_places_, "among too few distinct places"),
        std::pair(refused(Rejection::kSimilarity), "but not enough to be registered"),
        std::pair(refused(Rejection::kAmbiguous), "where the drive looks alike for long"),
        std::pair(refused(Rejection::kRegistration), "but their points do not fit"),
        std::pair(refused(Rejection::kNoPoints), "but their places were stored without points")})
    if (n > 0) text += str(", ", n, " more look alike, ", why);
  return skipped_ > 0 ? str(text, ", ", skipped_, " scans skipped") : text;
}

}  // namespace revisit

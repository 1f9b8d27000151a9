#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace revisit {

/// Confidence of a match, which thresholds are compared with.
enum class Score {
  /// 2 c1 - ck: the best's similarity plus its margin to the k-th (paper, section III-D).
  kMargin,
  /// As kMargin with the k-th distinct place (Comparison::same_place), so that it does not depend
  /// on how densely places are stored.
  kDistinctMargin,
  kSimilarity,  ///< c1, the similarity of the best
  /// Of a registered loop, by LoopDetector: s^2 (0.1 c1 + 0.05 (c1 - ck)) + L - phi. phi is the
  /// contradiction of both scans by free space (mutual_contradiction(); 0.5 if they are not
  /// judged), s the mean of their scales (scene_scale()), L the usual contradiction of consecutive
  /// scans. A loop that misses the threshold by at most 0.2 s, and agrees with a loop just before,
  /// has the threshold.
  kVerified,
};
/// Parses "margin", "distinct-margin", "similarity" or "verified"; throws
/// UsageError for anything else.
Score parse_score(const std::string& text);
/// Inverse of parse_score().
const char* name_of(Score score);

/// Indices count from 0: map entries for a PlaceIndex, rows of the data set for the evaluation.
struct Match {
  int64_t query = 0;  ///< row of the query
  /// Map entries, best first: min(k, candidates). For Score::kDistinctMargin, distinct places only;
  /// if fewer than k are distinct, the last entry examined is appended.
  std::vector<int64_t> ranks;
  std::vector<double> similarities;  ///< [ranks], non-increasing; cosines by default
  double score = 0;                  ///< SearchOptions::score
  int which_case = 1;                ///< alignment case of the query's best descriptor: 1 or 2
  /// yaw(query) - yaw(best), counter-clockwise [rad], if the descriptors determine it.
  std::optional<double> relative_yaw = {};
};

/// Excludes temporal neighbors: a candidate must be MORE than `amount` away to be a revisit.
struct Exclusion {
  /// What is measured between two scans.
  enum class Kind {
    kNone,     ///< nothing: no scan is excluded
    kFrames,   ///< difference of frame indices
    kSeconds,  ///< difference of time stamps [s]
    kMeters,   ///< path length between the two [m], by poses or else by registered motion
  };
  Kind kind = Kind::kMeters;  ///< what `amount` limits
  double amount = 30;         ///< [frames], [s] or [m]
  bool operator==(const Exclusion&) const = default;
};
/// Parses "frames=50", "seconds=30", "meters=50" or "none". Throws UsageError,
/// prefixed by `what`.
Exclusion parse_exclusion(const std::string& text, const char* what = "exclusion");
std::string to_string(const Exclusion& exclusion);  ///< inverse of parse_exclusion()

/// Measures a drive. A halt has no length: the path in meters is that between positions at least
/// 0.5 m apart.
class ExclusionCounter {
 public:
  /// Begins a drive.
  explicit ExclusionCounter(const Exclusion& exclusion) : exclusion_(exclusion) {}
  /// Distance of the next scan along the drive, in frames, seconds or meters. `registered`: motion
  /// since the scan before [m], for scans without a position. If both are absent, a scan counts as
  /// a fiftieth of the exclusion. Throws UsageError without a time in seconds.
  double at(int64_t frame, const std::optional<double>& time,
            const std::optional<Eigen::Vector3d>& position,
            const std::optional<double>& registered = std::nullopt);

 private:
  Exclusion exclusion_;
  double meters_ = 0;                         ///< of the scan before
  double base_ = 0;                           ///< at `reference_`
  std::optional<Eigen::Vector3d> reference_;  ///< position
};

/// Map entries that a query may return, [begin, end). Entries in no range are excluded.
struct CandidateRange {
  int64_t begin = 0, end = 0;                   ///< indices
  int64_t size() const { return end - begin; }  ///< number of entries
};

/// Proposes map entries. It may miss some; an exact comparison follows.
class CandidateSource {
 public:
  virtual ~CandidateSource() = default;
  /// Entries are 0 to size() - 1.
  virtual int64_t size() const = 0;
  virtual void add(std::span<const float> descriptor) = 0;  ///< the next entry
  /// Writes distinct entries to `places`, in any order: the `count` of `among` most similar to
  /// `query`, or fewer if it finds fewer. `among` is ascending, without empty ranges, within
  /// size(). Must be thread-safe. `threads` are used by this call and do not change the result.
  virtual void find(std::span<const float> query, std::span<const CandidateRange> among,
                    int64_t count, int threads, std::vector<int64_t>& places) const = 0;
};

/// How descriptors are compared.
struct Comparison {
  /// Larger is more similar. One call has all candidates of a query, because a probability over
  /// places needs them together. Must be thread-safe. Empty: cosine.
  std::function<void(std::span<const float> query, std::span<const std::span<const float>> places,
                     std::span<double> similarities)>
      similarity;
  /// Places with at least this similarity count as one: consecutive frames, another pass, or a
  /// standing sensor. Absent: similarities do not identify a place.
  std::optional<double> same_place;
  /// Returns yaw(b) - yaw(a), counter-clockwise [rad]. Empty: descriptors do not determine it.
  std::function<double(std::span<const float> a, std::span<const float> b)> relative_yaw;

  /// Makes an empty source that compares compact codes of descriptors. Empty: no codes.
  std::function<std::unique_ptr<CandidateSource>()> make_codes;
  int64_t candidates = 0;  ///< number of candidates preselected by the codes; 0: all places

  /// Similarity of two descriptors.
  double similarity_of(std::span<const float> a, std::span<const float> b) const;
};

}  // namespace revisit

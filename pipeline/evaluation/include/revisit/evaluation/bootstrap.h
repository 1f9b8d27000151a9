#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "revisit/evaluation/precision_recall.h"

namespace revisit {

/// Percentile block bootstrap (Carlstein 1986; Künsch 1989): each resample draws as many blocks of
/// consecutive queries as there are, with replacement. Queries of a block show the same street:
/// resampling single queries (Efron 1979) would make the intervals too narrow.
struct BootstrapOptions {
  std::vector<int64_t> blocks;  // per query: id of its block
  int resamples = 1000;
  double confidence = 0.95;
  uint64_t seed = 1;
  int threads = 1;             // does not affect the result
  std::function<bool()> stop;  // true: throw Interrupted
};

struct BlockCounts {
  int64_t all = 0;
  int64_t positive = 0;  // with a query that has a true match; they decide the width of intervals
};

BlockCounts count_blocks(const BootstrapOptions& options,
                         const std::function<bool(size_t query)>& is_positive);

struct Interval {
  double low = 0, high = 0;  // NaN: not computed
};

/// Default length of a block: 100 m driven, beyond which errors are almost uncorrelated. Without
/// poses 50 frames, as in the default Exclusion: about 50 m of KITTI, 100 m of keyframes 2 m apart.
inline constexpr Exclusion kBlockOfPath{Exclusion::Kind::kMeters, 100};
inline constexpr Exclusion kBlockOfFrames{Exclusion::Kind::kFrames, 50};

/// Block of each query of the task. Absent length: the default; Exclusion::Kind::kNone: each query
/// is a block. With named places each place is a block. Throws UsageError if `length` is 0 or needs
/// times or poses that are missing.
std::vector<int64_t> blocks_of(const Task& task, const Trajectory& trajectory,
                               const std::optional<Exclusion>& length = {});

struct PrIntervals {
  Interval f1_max, average_precision, recall_at_1, max_recall_at_precision_1, extended_precision;
};

/// Resamples without a positive are skipped. With a single block nothing is computed. The intervals
/// do not cover the variation between drives, which is larger.
/// Throws UsageError for less than 1 resample or thread, a confidence outside (0, 1), and unless
/// `blocks` has one id per query.
PrIntervals bootstrap(const std::vector<MatchLabel>& labels, Missed missed = Missed::kNotFound,
                      const BootstrapOptions& options = {});

}  // namespace revisit

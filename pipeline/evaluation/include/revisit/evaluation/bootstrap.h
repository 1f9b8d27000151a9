#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "revisit/evaluation/precision_recall.h"

namespace revisit::pipeline {

/// The percentile bootstrap of blocks (Carlstein 1986; Künsch 1989): as many blocks of consecutive
/// queries as there are, drawn with replacement. Queries of a block see the same street, so they
/// are right or wrong together; single queries, drawn by themselves (Efron 1979), would make
/// intervals too narrow.
struct BootstrapOptions {
  std::vector<int64_t> blocks;  // of each query: its block, any number
  int resamples = 1000;
  double confidence = 0.95;
  uint64_t seed = 1;
  int threads = 1;             // the result is the same for any number
  std::function<bool()> stop;  // true: throw Interrupted
};

struct BlockCounts {
  int64_t all = 0;
  int64_t positive = 0;  // with a query that has a true match: so few decide how wide intervals are
};

BlockCounts count_blocks(const BootstrapOptions& options,
                         const std::function<bool(size_t query)>& is_positive);

struct Interval {
  double low = 0, high = 0;  // NaN: not computed
};

/// Length of a block of queries where nothing else is said: 100 m driven, beyond which errors of
/// drives hardly depend on each other. Without poses it has as many frames as Exclusion has, which
/// keeps scans of one moment apart: about 50 m of KITTI, 100 m of keyframes 2 m apart.
inline constexpr Exclusion kBlockOfPath{Exclusion::Kind::kMetres, 100};
inline constexpr Exclusion kBlockOfFrames{Exclusion::Kind::kFrames, 50};

/// The block of each of the task's queries: `length` long, or else as above. None: each query is a
/// block. Of named places each is one. Throws UsageError when `length` needs times or poses that
/// are not there, or is 0.
std::vector<int64_t> blocks_of(const Task& task, const Trajectory& trajectory,
                               const std::optional<Exclusion>& length = {});

struct PrIntervals {
  Interval f1_max, average_precision, recall_at_1, max_recall_at_precision_1, extended_precision;
};

/// Intervals over the queries; resamples without a positive are left out. Nothing is computed of a
/// single block. Drives differ by more than the parts of one do.
///
///   auto ci = bootstrap(verdicts, task.missed, {.blocks = blocks_of(task, trajectory)});
///   ci.average_precision.low;
///
/// Throws UsageError for less than 1 resample or thread, a confidence outside (0, 1), and unless
/// there is a block for each query.
PrIntervals bootstrap(const std::vector<Verdict>& verdicts, Missed missed = Missed::kNotFound,
                      const BootstrapOptions& options = {});

}  // namespace revisit::pipeline

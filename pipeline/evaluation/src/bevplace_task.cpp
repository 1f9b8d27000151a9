#include "kitti_drives.h"
#include "protocol_tasks.h"
#include "revisit/base/error.h"

namespace revisit::pipeline {
namespace {

/// Frames, half open. 00, 02, 05 and 06 as published with BEVPlace, 08 with BEVPlace++; what is
/// between database and queries is left out there.
struct Ranges {
  const char* sequence;
  int database_end, query_begin, query_end;
};
constexpr Ranges kRanges[] = {{"00", 3000, 3200, 4541},
                              {"02", 3400, 3600, 4661},
                              {"05", 1000, 1200, 2751},
                              {"06", 600, 800, 1101},
                              {"08", 1000, 1200, 4071}};

const Ranges& ranges_of(const std::string& sequence) {
  for (const Ranges& ranges : kRanges)
    if (sequence == ranges.sequence) return ranges;
  throw UsageError(
      str("protocol bevplace: its ranges are published for 00, 02, 05, 06 and 08, not "
          "for sequence '",
          sequence, "'; online and leave-one-out work for any"));
}

}  // namespace

Task bevplace_task(const std::string& sequence, const Trajectory& trajectory) {
  const Ranges& r = ranges_of(sequence);
  need_official_drive("bevplace", sequence, trajectory);
  Task task = map_task(rows_where(trajectory, [&](int frame) { return frame < r.database_end; }),
                       rows_where(trajectory, [&](int frame) {
                         return frame >= r.query_begin && frame < r.query_end;
                       }));
  task.population = str("stored: frames 0-", r.database_end - 1, "; queries: frames ",
                        r.query_begin, "-", r.query_end - 1);
  task.rule = {Distance::kXz, 5};
  task.margin_score = false;
  return task;
}

}  // namespace revisit::pipeline

#pragma once

#include <filesystem>
#include <map>
#include <set>
#include <string>

#include "revisit/datasets/dataset.h"

namespace revisit::pipeline {

/// Ground truth as a list of pairs, for recordings without poses. A pair holds both ways; only its
/// query is asked.
struct ListedPairs {
  using Places = std::map<int, std::set<int>>;  // frame of a query -> frames of its places
  Places right;                                 // no places: the query is known to have none
  Places neither;                               // matches that are neither right nor wrong
  bool complete = false;  // a query that is not listed has no place; false: nobody knows

  bool knows(int query) const { return complete || right.contains(query); }
  std::string text() const;  // of all, for a key
};

/// Reads a table with a query and a place in the first two columns of each line, or in those that a
/// first line calls `query` and `place` (`match`, as `revisit gt --pairs` writes it). Commas,
/// semicolons, tabs or blanks part columns; what follows a # is skipped. A scan is named by its
/// frame or its file, without extension or with it, behind its folder in a data set of several:
/// "first/000032". A query without a place has none. Frames of the same folder at most `near` from
/// a place count, too.
///
///   trajectory.listed = {.right = read_pairs("loops.csv", dataset, 2)};
///
/// Throws InputError with file:line, also for a frame that the data set does not have, and for a
/// name that may be of several scans.
ListedPairs::Places read_pairs(const std::filesystem::path& file, const Dataset& dataset,
                               int near = 0);

}  // namespace revisit::pipeline

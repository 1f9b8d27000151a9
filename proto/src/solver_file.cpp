#include <google/protobuf/text_format.h>

#include <algorithm>
#include <vector>

#include "net_text.h"
#include "revisit/base/error.h"
#include "revisit/base/text.h"
#include "revisit/proto/limits.h"

namespace revisit::proto {
namespace {

namespace fs = std::filesystem;

/// Unique names of the nets of a solver that have a TEST phase.
std::vector<std::string> named_nets(const caffe::SolverParameter& solver) {
  std::vector<std::string> names(solver.test_net().begin(), solver.test_net().end());
  if (solver.has_net()) names.push_back(solver.net());
  if (names.empty() && solver.has_train_net()) names.push_back(solver.train_net());
  std::sort(names.begin(), names.end());
  names.erase(std::unique(names.begin(), names.end()), names.end());
  return names;
}

fs::path find_net(const std::string& name, const fs::path& solver) {
  const fs::path beside = solver.parent_path() / name;  // `name` itself if absolute
  for (const fs::path& candidate : {beside, fs::path(name)}) {
    std::error_code ignored;
    if (fs::is_regular_file(candidate, ignored)) return candidate;
  }
  throw InputError(solver.string(), ": is a solver file; the net it names, '", name,
                   "', is neither in its folder nor in the working folder; give the net itself");
}

}  // namespace

std::optional<SolverNet> net_of_solver(const std::string& text, const fs::path& path) {
  caffe::SolverParameter solver;
  google::protobuf::TextFormat::Parser parser;
  Silence silence;
  parser.RecordErrorsTo(&silence);
  parser.AllowPartialMessage(true);
  parser.SetRecursionLimit(kMaxNesting);
  if (!parser.ParseFromString(text, &solver)) return std::nullopt;
  const bool has_net_inside =
      solver.has_net_param() || solver.has_train_net_param() || solver.test_net_param_size() > 0;
  const std::vector<std::string> names = named_nets(solver);
  if (names.empty() && !has_net_inside) return std::nullopt;

  const auto fail = [&](const auto&... reason) {
    throw InputError(path.string(), ": is a solver file ", reason...);
  };
  if (has_net_inside) fail("with an embedded net; move the net to its own prototxt and give that");
  if (names.size() > 1)
    fail("that names several nets: '", joined(names, "', '"), "'; give one of them");
  if (solver.test_state_size() > 1)
    fail("that tests its net in several states; give the net itself, '", names[0], "'");
  SolverNet result{find_net(names[0], path), {}};
  if (solver.test_state_size() == 1) result.state = solver.test_state(0);
  return result;
}

}  // namespace revisit::proto

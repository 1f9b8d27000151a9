// Unusual prototxts must be accepted or rejected as by the original Caffe (tests/golden/parse),
// except for the differences in docs/reference/LAYERS.md.
#include <google/protobuf/struct.pb.h>
#include <google/protobuf/util/json_util.h>

#include "revisit/engine/net.h"
#include "revisit/proto/net_file.h"
#include "testing.h"

namespace revisit::engine {
namespace {

using Shapes = std::map<std::string, std::vector<int64_t>>;  // by blob

struct Verdict {
  bool accept = false;
  Shapes blobs;
  std::string reason;        // of the rejection
  std::string position;      // "line:column" in the text, where Caffe gives one
  bool unsupported = false;  // because of an unknown layer type
};

/// Intended differences to Caffe, each with a row of docs/reference/LAYERS.md that begins with the name.
struct Difference {
  const char* name;
  bool we_accept;
};
constexpr Difference kDifferences[] = {
    {"engine_cudnn", true},
    {"net_inplace_conv", false},
    {"net_inplace_lrn", false},
    {"net_inplace_pool", false},
};

std::map<std::string, Verdict> caffe_verdicts(const fs::path& index) {
  google::protobuf::Struct json;
  EXPECT_TRUE(google::protobuf::util::JsonStringToMessage(read_file(index), &json).ok());
  std::map<std::string, Verdict> verdicts;
  for (const auto& [name, value] : json.fields()) {
    const auto& fields = value.struct_value().fields();
    Verdict& verdict = verdicts[name];
    verdict.accept = fields.at("accept").bool_value();
    if (!verdict.accept) {
      verdict.reason = fields.at("error").string_value();
      constexpr std::string_view start = "Error parsing text-format caffe.NetParameter: ";
      if (verdict.reason.starts_with(start))
        verdict.position = verdict.reason.substr(
            start.size(), verdict.reason.find(": ", start.size()) - start.size());
      continue;
    }
    for (const auto& [blob, shape] : fields.at("blobs").struct_value().fields()) {
      if (blob.find("_split_") != std::string::npos) continue;  // inserted by Caffe
      std::vector<int64_t>& axes = verdict.blobs[blob];
      for (const auto& size : shape.list_value().values())
        axes.push_back(static_cast<int64_t>(size.number_value()));
    }
  }
  return verdicts;
}

Verdict our_verdict(const fs::path& prototxt) {
  Verdict verdict;
  try {
    const Plan plan = Net::load_without_weights(prototxt).plan();
    const auto net = proto::read_net(prototxt).net;
    EXPECT_EQ(plan.layers().size(), static_cast<size_t>(net.layer_size()));
    for (int i = 0; i < net.layer_size(); ++i)
      for (int top = 0; top < net.layer(i).top_size(); ++top)
        verdict.blobs[net.layer(i).top(top)] = plan.layers().at(i).outputs.at(top).axes();
    verdict.accept = true;
  } catch (const Error& error) {
    verdict.unsupported = dynamic_cast<const UnsupportedError*>(&error) != nullptr;
    verdict.reason = error.what();
    EXPECT_HAS(verdict.reason, prototxt.filename().string());
  }
  return verdict;
}

TEST(ParseVerdicts, AreThoseOfCaffe) {
  const std::filesystem::path folder = test::golden("parse");
  const auto labels = caffe_verdicts(folder / "index.json");
  EXPECT_EQ(labels.size(), 77U);
  for (const auto& [name, caffe] : labels) {
    SCOPED_TRACE(name);
    const Verdict ours = our_verdict(folder / (name + ".prototxt"));
    const auto* difference =
        std::find_if(std::begin(kDifferences), std::end(kDifferences),
                     [&, &key = name](const Difference& entry) { return key == entry.name; });
    const bool differs = difference != std::end(kDifferences);
    EXPECT_EQ(ours.accept, differs ? difference->we_accept : caffe.accept)
        << "Caffe: " << caffe.reason << "\nwe: " << ours.reason;
    if (differs) {
      EXPECT_NE(ours.accept, caffe.accept) << "no difference any more";
    }
    // An unsupported type does not make the file invalid.
    EXPECT_EQ(ours.unsupported, name == "net_type_unknown" || name == "pool_stochastic")
        << ours.reason;
    if (ours.accept && caffe.accept) {
      EXPECT_EQ(ours.blobs, caffe.blobs);
    }
    // For a wrong name Caffe reports its end, we its beginning, so only the lines match.
    const bool is_name = name == "syn_unknown_top_field" || name == "syn_enum_lower" ||
                         name == "syn_dup_scalar" || name == "syn_dup_message";
    const size_t n_same = is_name ? caffe.position.find(':') : caffe.position.size();
    if (!caffe.position.empty()) {
      EXPECT_HAS(ours.reason, name + ".prototxt:" + caffe.position.substr(0, n_same) + ":");
    }
  }
}

TEST(ParseVerdicts, DifferencesAreThoseOfTheDocument) {
  std::vector<std::string> rows, listed;
  std::istringstream text(read_file(test::project_file("docs/reference/LAYERS.md")));
  for (std::string line; std::getline(text, line);) {
    constexpr std::string_view start = "| `";
    if (line.starts_with(start))
      rows.push_back(line.substr(start.size(), line.find('`', start.size()) - start.size()));
  }
  for (const Difference& difference : kDifferences) listed.emplace_back(difference.name);
  std::sort(rows.begin(), rows.end());
  EXPECT_EQ(rows, listed);
}

}  // namespace
}  // namespace revisit::engine

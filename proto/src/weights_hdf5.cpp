#include <algorithm>
#include <array>
#include <charconv>
#include <optional>
#include <set>

#include "hdf5_file.h"
#include "revisit/base/text.h"
#include "revisit/proto/limits.h"

namespace revisit::proto {
namespace {

constexpr size_t kMaxNameParts = 16;    // parts of a layer name; "fire2/squeeze1x1" has two
constexpr int64_t kMaxBlobs = 64;       // per layer
constexpr int64_t kStepsPerLayer = 16;  // links, blobs and tree nodes, on average
constexpr int kMaxHops = 16;            // soft links in a chain

/// Parses "12"; returns -1 for anything else ("007", "x", "-1").
int64_t index_of(const std::string& name) {
  int64_t index = -1;
  const auto [end, error] = std::from_chars(name.data(), name.data() + name.size(), index);
  const bool canonical = error == std::errc() && end == name.data() + name.size() &&
                         (name.size() == 1 || name[0] != '0');
  return canonical && index >= 0 ? index : -1;
}

class Hdf5Weights final : public WeightsFile {
 public:
  Hdf5Weights(FileCursor cursor, const Limits& limits) : WeightsFile(std::move(cursor), limits) {
    explain("", [&] {
      file_.emplace(cursor_, limits.layers * kStepsPerLayer);
      const Hdf5Links& top = file_->links(file_->root());
      const auto data = top.find("data");
      const std::optional<uint64_t> group =
          data == top.end() ? std::nullopt : follow(file_->root(), data->second, 0);
      if (!group || !file_->object(*group).is_group)
        fail("HDF5 file without the group /data, where Caffe stores weights");
      visited_groups_.insert(*group);
      index_group(*group, "", 0, true);
      if (layers_.empty()) fail("HDF5 file without layers in /data");
    });
  }

  std::vector<Blob> read(size_t index) override {
    std::vector<Blob> blobs(layers_.at(index).n_blobs);
    for (size_t i = 0; i < blobs.size(); ++i) {
      blobs[i].absent = !blobs_[index][i];
      if (blobs[i].absent) continue;
      const std::string place = str("layer '", layers_[index].name, "', blob ", i, ": ");
      explain(place, [&] { read_blob(*blobs_[index][i], place, blobs[i]); });
    }
    return blobs;
  }

 private:
  template <class... Parts>
  [[noreturn]] void fail(const Parts&... reason) const {
    throw InputError(cursor_.file().string(), ": ", reason...);
  }

  template <class Action>
  void explain(const std::string& place, Action&& action) {
    try {
      action();
    } catch (const FormatError& error) {
      fail("byte ", error.offset, ": ", place, "corrupt HDF5 file: ", error);
    } catch (const Hdf5Unsupported& error) {
      throw UnsupportedError(cursor_.file().string(), ": ", place, error.what());
    }
  }

  /// Returns nullopt if the link dangles.
  std::optional<uint64_t> follow(uint64_t group, const Hdf5Link& link, int hops) {
    if (link.target.empty()) return link.object;
    if (hops == kMaxHops) return std::nullopt;
    uint64_t object = link.target[0] == '/' ? file_->root() : group;
    for (size_t begin = 0; begin < link.target.size();) {
      const size_t end = std::min(link.target.find('/', begin), link.target.size());
      const std::string part = link.target.substr(begin, end - begin);
      begin = end + 1;
      if (part.empty() || part == ".") continue;
      file_->spend(1);
      if (!file_->object(object).is_group) return std::nullopt;
      const Hdf5Links& links = file_->links(object);
      const auto next = links.find(part);
      if (next == links.end()) return std::nullopt;
      const std::optional<uint64_t> reached = follow(object, next->second, hops + 1);
      if (!reached) return std::nullopt;
      object = *reached;
    }
    return object;
  }

  /// Adds the layer of a group and, if `with_groups`, those below it, with its name as prefix.
  void index_group(uint64_t group, const std::string& name, size_t depth, bool with_groups) {
    std::vector<std::optional<uint64_t>> blobs;
    bool has_groups = false;
    const std::string prefix = name.empty() ? "" : name + "/";
    for (const auto& [part, link] : file_->links(group)) {
      const std::string place = prefix + part;
      const int64_t index = name.empty() ? -1 : index_of(part);
      const std::optional<uint64_t> address = follow(group, link, 0);
      const Hdf5Object object = address ? file_->object(*address) : Hdf5Object();
      if (object.is_group) {
        has_groups = true;
        if (!with_groups) continue;
        if (depth + 1 == kMaxNameParts)
          fail("'/data/", place, "' is nested too deeply for a layer name");
        // Links can form cycles: each group is visited once, under its own name.
        const bool is_own = link.target.empty() && visited_groups_.insert(*address).second;
        index_group(*address, place, depth + 1, is_own);
      } else if (index >= 0) {
        if (!object.is_array) fail("'/data/", place, "' does not lead to an array of this file");
        if (index >= kMaxBlobs)
          fail("layer '", name, "' has blob ", index, "; the limit is ", kMaxBlobs, " blobs");
        blobs.resize(std::max(blobs.size(), static_cast<size_t>(index) + 1));
        blobs[static_cast<size_t>(index)] = address;
      }
    }
    if (name.empty() || (blobs.empty() && has_groups)) return;
    if (static_cast<int64_t>(layers_.size()) == limits_.layers)
      fail("more than ", limits_.layers, " layers (raise the limit of layers)");
    layers_.push_back({name, blobs.size()});
    blobs_.push_back(std::move(blobs));
  }

  void read_blob(uint64_t address, const std::string& place, Blob& blob) {
    const Hdf5Object array = file_->object(address);
    if (!array.unsupported.empty()) throw Hdf5Unsupported(array.unsupported);
    const NumberReader number = number_reader(array.number);
    if (!number) throw Hdf5Unsupported("holds no floats, doubles or integers");
    const auto blame = [&](const auto&... reason) {
      fail(place, "shape ", shape_text(array.shape), " ", reason...);
    };
    uint64_t elements = 1;
    for (const int64_t dim : array.shape) {
      if (dim < 0 || (dim > 0 && elements > static_cast<uint64_t>(kMaxElements / dim)))
        blame("has more than ", kMaxElements, " elements");
      elements *= static_cast<uint64_t>(dim);
    }
    const uint64_t bytes = elements * array.number.bytes;
    if (bytes > 0 && !array.is_written) blame("has no stored values");
    if (bytes > 0 && bytes != array.stored) blame("needs ", bytes, " bytes, found ", array.stored);
    if (bytes > cursor_.size() || array.begin > cursor_.size() - bytes)
      blame("needs ", bytes, " bytes at ", array.begin, ", beyond the end of the file");

    blob.shape = array.shape;
    blob.data.resize(elements);
    cursor_.seek(array.begin);
    if (array.number.kind == 'f' && array.number.bytes == sizeof(float) &&
        !array.number.big_endian) {
      cursor_.read(blob.data.data(), bytes);
      return;
    }
    std::array<char, sizeof(int64_t)> stored;
    for (float& value : blob.data) {
      cursor_.read(stored.data(), array.number.bytes);
      value = static_cast<float>(number(stored.data()));
    }
  }

  std::optional<Hdf5File> file_;
  std::vector<std::vector<std::optional<uint64_t>>> blobs_;  // addresses; nothing: absent
  std::set<uint64_t> visited_groups_;
};

}  // namespace

bool is_hdf5(std::string_view head) {
  return head.starts_with("\x89HDF\r\n\x1a\n");
}

std::unique_ptr<WeightsFile> open_hdf5(FileCursor cursor, const Limits& limits) {
  return std::make_unique<Hdf5Weights>(std::move(cursor), limits);
}

}  // namespace revisit::proto

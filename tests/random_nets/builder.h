#pragma once

#include <functional>

#include "random.h"
#include "random_net.h"

namespace revisit::random_nets {

/// An attempt to add a layer that does not fit what is there.
struct Unfit {};

/// A blob as the layers so far leave it.
struct Value {
  std::string blob;
  engine::Shape shape;
  bool exact = true;     // no layer that rounds is before it: what compares it sees the same bits
  bool dynamic = false;  // the number of rows depends on the data: not for pick()
  bool hidden = false;   // only who knows it may read it
  int readers = 0;
  size_t memory = 0;  // the first value in the memory that Caffe has it in
};

/// A net that grows layer by layer; the engine itself says what fits.
class Builder {
 public:
  using Condition = std::function<bool(const Value&)>;

  explicit Builder(uint64_t seed) : random(seed) {}

  /// Adds an input. `hidden`: not for pick().
  size_t add_input(const Input& input, bool hidden = false);
  /// Adds a layer, perhaps in place, and returns its first output; the others follow it. `params`
  /// is text of a LayerParameter. Throws Unfit.
  size_t add(const std::string& type, const std::vector<size_t>& inputs,
             const std::string& params = "", size_t n_outputs = 1);

  /// A value for a layer to read, sooner a late one or one that nothing reads. Throws Unfit when
  /// there is none.
  size_t pick(const Condition& fits);
  size_t any() {
    return pick([](const Value&) { return true; });
  }
  size_t exact() {
    return pick([](const Value& v) { return v.exact; });
  }
  size_t of_rank(size_t least, size_t most = 9);
  /// A value of the same shape as `like`: an old one, or a new branch from it or beside it.
  size_t same_shape(size_t like);

  const Value& value(size_t id) const { return values_[id]; }
  const engine::Shape& shape(size_t id) const { return values_[id].shape; }
  size_t n_values() const { return values_.size(); }
  Size axis_of(size_t id, size_t axis) const { return {1, {}, {{values_[id].blob, axis}}}; }
  void mark_dynamic(size_t id) { values_[id].dynamic = true; }

  Random random;
  RandomNet result;
  bool takes_inputs = true;  // more than the first

 private:
  void add_weights(const engine::Shape& shape, const std::string& type, size_t blob,
                   caffe::LayerParameter* layer);
  std::string fresh_name(const std::string& type);

  std::vector<Value> values_;
  double work_ = 0;  // multiply-accumulates
};

/// How to add a layer of each type at random; some add others that it needs.
struct LayerMaker {
  const char* type;
  int weight;  // how often, beside the others
  void (*make)(Builder&, const char* type);
};
const std::vector<LayerMaker>& layer_makers();

/// "kernel_size: 3 stride: 2 ..." for `axes` spatial axes.
std::string random_windows(Random& random, size_t axes);

}  // namespace revisit::random_nets

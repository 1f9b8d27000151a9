#pragma once

#include <functional>

#include "random.h"
#include "random_net.h"

namespace revisit::random_nets {

/// Thrown if a layer does not fit the existing blobs.
struct Unfit {};

struct Value {
  std::string blob;
  engine::Shape shape;
  bool exact = true;     // no earlier layer rounds, so that comparisons see equal bits
  bool dynamic = false;  // the number of rows depends on the data: not for pick()
  bool hidden = false;   // not for pick()
  int readers = 0;
  size_t memory = 0;  // first value in the memory where Caffe stores it
};

/// Builds a net layer by layer; throws Unfit if the engine rejects a layer.
class Builder {
 public:
  using Condition = std::function<bool(const Value&)>;

  explicit Builder(uint64_t seed) : random(seed) {}

  size_t add_input(const Input& input, bool hidden = false);
  /// May work in place. Returns the first output; the others follow it. `params` is text of a
  /// LayerParameter. Throws Unfit.
  size_t add(const std::string& type, const std::vector<size_t>& inputs,
             const std::string& params = "", size_t n_outputs = 1);

  /// Prefers late and unread values. Throws Unfit if there is none.
  size_t pick(const Condition& fits);
  size_t any() {
    return pick([](const Value&) { return true; });
  }
  size_t exact() {
    return pick([](const Value& v) { return v.exact; });
  }
  size_t of_rank(size_t least, size_t most = 9);
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

struct LayerMaker {
  const char* type;
  int weight;
  void (*make)(Builder&, const char* type);
};
const std::vector<LayerMaker>& layer_makers();

std::string random_windows(Random& random, size_t axes);

}  // namespace revisit::random_nets

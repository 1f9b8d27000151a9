#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "net_impl.h"
#include "revisit/engine/net.h"
#include "schedule.h"

namespace revisit::engine {

/// Dependence of a value's shape on a number of rows that a layer determines at run time.
struct DynamicRows {
  size_t layer;  // index into Graph::nodes
  size_t axis;
  int64_t multiple;  // size of that axis per row, because views can merge other axes into it
};

/// Returns the dependence for each value of the net; nullopt for values of fixed size. Plans are
/// made for the maximum number of rows. Such a value can be an output of the net, pass through
/// views, or be read by layers that process items independently (Layer::keeps_items()). These
/// compute all rows; superfluous ones are cut off. Throws UnsupportedError with the layer for any
/// other reader.
std::vector<std::optional<DynamicRows>> dynamic_rows(const Net::Impl& net,
                                                     const std::vector<Shape>& shapes);

struct Plan::Impl {
  struct Slot {
    int64_t offset;  // [bytes]
    Shape shape;     // the maximum with dynamic rows
    std::optional<DynamicRows> rows;
  };
  std::shared_ptr<const Net::Impl> net;
  Schedule schedule;  // only steps that run
  std::vector<LayerCost> costs;
  std::vector<Port> inputs, outputs;
  std::map<std::string, Slot, std::less<>> input_slots, output_slots;
  std::map<std::string, Slot, std::less<>> layer_slots;  // kept outputs by port_name()
  bool flush_denormals = true;
  int blas_threads = 0;  // threads that call OpenBLAS concurrently
  int64_t weight_bytes = 0;
};

// Limits that are checked before allocation, because a short prototxt can request any amount.
// Errors name the layer, the limit and the fix.

constexpr int64_t kMegabyte = 1 << 20;

void check_weight_bytes(const Net::Impl& net, int64_t limit);

/// Checks the outputs of one layer together. The error has only a reason, as in Layer.
void check_outputs(const std::vector<Shape>& outputs, int64_t limit);

/// Checks a plan whose schedule is placed.
void check_run_memory(const Plan::Impl& plan, int64_t limit);

void check_threads(int threads);

std::vector<LayerCost> layer_costs(const Net::Impl& net, const std::vector<Shape>& shapes,
                                   const Operations& operations, const Schedule& schedule);

/// Receptive field of a value along one axis; nullopt: the entire input.
using Field = std::optional<ReceptiveField>;

/// Receptive fields along rows and columns; by default those of a net input.
struct FieldHw {
  Field h = ReceptiveField{}, w = ReceptiveField{};
};

/// Returns the field of a layer's output: the smallest interval that contains the fields of all
/// inputs. Returns nullopt if one of them is unbounded or strides differ.
Field field_through(const std::vector<Field>& inputs, const Window& window);

/// Sets `cost->field_h` and `field_w` if the first output has rows and columns. `cost` must have
/// the shapes; `fields` has those of all earlier values, and the node's outputs are added.
void trace_field(const Node& node, std::vector<FieldHw>* fields, LayerCost* cost);

}  // namespace revisit::engine

#include <algorithm>
#include <iostream>
#include <limits>

#include "cli/json.h"
#include "cli/terminal.h"
#include "net_commands.h"
#include "revisit/base/text.h"
#include "revisit/engine/machine.h"

namespace revisit::cli {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

template <class Repeated>
void set_shape(const engine::Shape& shape, Repeated* out) {
  for (const int64_t size : shape.axes()) out->Add(static_cast<int>(size));
}

void set_named_shape(const std::string& name, const engine::Shape& shape,
                     reports::NamedShape* out) {
  out->set_name(name);
  set_shape(shape, out->mutable_shape());
}

void set_blobs(const engine::LayerCost& cost, reports::NetLayer* layer) {
  for (size_t i = 0; i < cost.inputs.size(); ++i)
    set_named_shape(cost.input_blobs[i], cost.inputs[i], layer->add_bottoms());
  for (size_t i = 0; i < cost.outputs.size(); ++i)
    set_named_shape(cost.blobs[i], cost.outputs[i], layer->add_tops());
  for (const engine::Shape& shape : cost.weights)
    set_shape(shape, layer->add_blobs()->mutable_shape());
}

std::vector<int64_t> axes_of(const google::protobuf::RepeatedField<int32_t>& shape) {
  return {shape.begin(), shape.end()};
}

reports::Timing timing(const profiling::Timing& t) {
  reports::Timing result;
  result.set_min(t.min), result.set_median(t.median), result.set_p95(t.p95);
  result.set_low(t.low), result.set_high(t.high), result.set_confidence(t.confidence);
  return result;
}

double gflops(double macs, double ms) {
  return ms > 0 ? 2 * macs / ms / 1e6 : 0;  // a MAC is two operations
}

reports::ReceptiveField receptive_field(const engine::ReceptiveField& field) {
  reports::ReceptiveField result;
  result.set_size(static_cast<double>(field.size));
  result.set_stride(static_cast<double>(field.stride));
  result.set_start(static_cast<double>(field.start));
  return result;
}

/// "11x51 /4,8 @0,-16": size, strides and start of rows and columns.
std::string field_text(const reports::NetLayer& layer) {
  if (!layer.has_field_w()) return "-";
  const auto pair = [&](auto get, const char* separator) {
    const std::string w = number(get(layer.field_w()), 0);
    return layer.has_field_h() ? number(get(layer.field_h()), 0) + separator + w : w;
  };
  return pair([](const auto& f) { return f.size(); }, "x") + " /" +
         pair([](const auto& f) { return f.stride(); }, ",") + " @" +
         pair([](const auto& f) { return f.start(); }, ",");
}

std::string mebi(double bytes) {
  return number(bytes / 1048576, 2);
}

/// Headroom of the layer to the roofline; NaN if nothing runs.
double gain_ms(const reports::NetLayer& layer) {
  return layer.has_best_ms() ? std::max(layer.ms().median() - layer.best_ms(), 0.0) : kNone;
}

Table layer_table(const reports::NetReport& report) {
  const bool timed = report.has_total_ms();
  std::vector<std::string> header{"layer",      "type",  "kernel",     "reason",    "output",
                                  "parameters", "MMACs", "packed MiB", "memory MiB"};
  if (!timed) header.push_back("sees /stride @start");
  if (timed)
    header.insert(header.end(), {"min ms", "median ms", "p95 ms", "GFLOP/s", "time %", "peak %",
                                 "memory %", "gain ms"});
  Table table(std::move(header));
  for (const reports::NetLayer& layer : report.layers()) {
    std::vector<std::string> row{layer.name(),
                                 layer.type(),
                                 layer.kernel().empty() ? "-" : layer.kernel(),
                                 layer.reason().empty() ? "-" : layer.reason(),
                                 shape_text(axes_of(layer.output_shape())),
                                 number(layer.parameters(), 0),
                                 number(layer.macs() / 1e6, 2),
                                 mebi(layer.packed_weight_bytes()),
                                 mebi(layer.activation_bytes())};
    if (!timed) row.push_back(field_text(layer));
    if (timed)
      for (const auto& [value, digits] :
           {std::pair{layer.ms().min(), 3},
            {layer.ms().median(), 3},
            {layer.ms().p95(), 3},
            {layer.has_gflops() ? layer.gflops() : kNone, 1},
            {100 * layer.share(), 1},
            {layer.has_peak_share() ? 100 * layer.peak_share() : kNone, 1},
            {layer.has_memory_share() ? 100 * layer.memory_share() : kNone, 1},
            {gain_ms(layer), 3}})
        row.push_back(number(value, digits));
    table.row(std::move(row));
  }
  return table;
}

void print_limits(const reports::NetReport& report) {
  const reports::SpeedLimits& limits = report.limits();
  const reports::Bandwidth& memory = limits.bandwidths(limits.bandwidths_size() - 1);
  double nearest = 0;
  for (const reports::Bandwidth& bandwidth : limits.bandwidths())
    nearest = std::max({nearest, bandwidth.read(), bandwidth.copied()});
  std::cout << "limits of " << plural(limits.threads(), "thread") << ": "
            << number(limits.float32_gflops(), 1) << " GFLOP/s in float32"
            << (limits.bf16_gflops() > 0 ? ", " + number(limits.bf16_gflops(), 1) + " in bfloat16"
                                         : "")
            << "; memory " << number(memory.read(), 1) << " GB/s read, "
            << number(memory.copied(), 1) << " copied; caches up to " << number(nearest, 1)
            << " GB/s\n";
  std::vector<const reports::NetLayer*> layers;
  for (const reports::NetLayer& layer : report.layers())
    if (layer.has_best_ms()) layers.push_back(&layer);
  std::ranges::stable_sort(layers, std::ranges::greater{},
                           [](const auto* layer) { return gain_ms(*layer); });
  layers.resize(std::min<size_t>(layers.size(), 3));
  std::cout << "at these the layers take " << number(report.best_ms(), 3) << " ms, "
            << number(100 * report.best_ms() / report.layer_sum_ms().median(), 1)
            << " % of their sum; largest headroom: "
            << joined(layers, ", ",
                      [](const auto* layer) {
                        return printable(layer->name()) + " " + number(gain_ms(*layer), 3) + " ms";
                      })
            << "\n";
}

void print_comparison(const reports::NetReport& report) {
  const reports::NetComparison& against = report.baseline();
  Table table({"layer", "before ms", "now ms", "change %", "from %", "to %", "verdict"});
  const auto row = [&](const std::string& name, const reports::NetChange& change) {
    if (change.verdict().empty()) return;
    const auto share = [&](double value) {
      return change.has_change() ? (value > 0 ? "+" : "") + number(100 * value, 1) : "";
    };
    table.row({name, number(change.before_ms(), 3), number(change.now_ms(), 3),
               share(change.change()), share(change.low()), share(change.high()),
               change.verdict()});
  };
  for (const reports::NetChange& change : against.layers()) row(change.layer(), change);
  row("(sum of the layers)", against.layer_sum());
  row("(end to end, uninstrumented)", against.whole());
  std::cout << "\nagainst " << printable(against.file()) << ":\n";
  const auto setting = [](const char* what, const std::string& before, const std::string& now) {
    if (before != now)
      std::cout << "  " << what << ": " << printable(before) << " there, " << now << " here\n";
  };
  setting("threads", str(against.threads()), str(report.threads()));
  setting("precision", against.precision(), report.precision());
  setting("kernels", against.simd(), report.simd());
  const auto limits = [](const reports::SpeedLimits& of) {
    if (of.bandwidths().empty()) return std::string("unknown (busy)");
    return str(number(of.float32_gflops(), 1), " GFLOP/s, memory ",
               number(of.bandwidths(of.bandwidths_size() - 1).read(), 1), " GB/s");
  };
  setting("limits of the machine", limits(against.limits()), limits(report.limits()));
  table.print(std::cout);
}

/// " for a batch of 10, 1.582 per image"; "" for one image, and for nets of other inputs.
std::string batch_text(const reports::NetReport& report) {
  if (report.inputs().empty() || report.inputs(0).shape_size() < 4) return "";
  const int batch = report.inputs(0).shape(0);
  return batch > 1 ? str(" for a batch of ", batch, ", ", number(report.macs() / 1e9 / batch, 3),
                         " per image")
                   : "";
}

void print_summary(const reports::NetReport& report) {
  std::cout << "\nnet " << printable(report.net()) << ", weights " << printable(report.weights());
  if (report.has_weight_file_bytes())
    std::cout << " (read " << mebi(report.weight_bytes_read()) << " of "
              << mebi(report.weight_file_bytes()) << " MiB)";
  std::cout << "\n";
  for (const auto& [what, ports] :
       {std::pair("input  ", &report.inputs()), std::pair("output ", &report.outputs())})
    for (const reports::NamedShape& port : *ports)
      std::cout << what << printable(port.name()) << "  " << shape_text(axes_of(port.shape()))
                << "\n";
  std::cout << number(report.parameters(), 0) << " parameters (" << mebi(report.weight_bytes())
            << " MiB), " << number(report.macs() / 1e9, 3) << " GMACs" << batch_text(report)
            << ", one run takes " << mebi(report.arena_bytes())
            << " MiB of activations and scratch\n"
            << "memory: weights " << mebi(report.weight_bytes()) << " + packed for the kernels "
            << mebi(report.packed_weight_bytes()) << " + one run " << mebi(report.arena_bytes())
            << " = "
            << mebi(report.weight_bytes() + report.packed_weight_bytes() + report.arena_bytes())
            << " MiB\n";
  if (!report.has_total_ms()) return;
  const auto line = [](const char* what, const reports::Timing& t) {
    std::cout << what << "  min " << number(t.min(), 3) << "  median " << number(t.median(), 3)
              << "  p95 " << number(t.p95(), 3) << " ms\n";
  };
  line("end to end, uninstrumented ", report.total_ms());
  line("sum of the layers     ", report.layer_sum_ms());
  std::cout << report.passes() << " passes, " << plural(report.threads(), "thread") << ", "
            << number(report.gflops(), 1) << " GFLOP/s, peak resident memory "
            << mebi(report.peak_resident_bytes()) << " MiB\n";
  if (report.has_limits()) print_limits(report);
}

void print_buffers(const reports::NetReport& report) {
  Table table({"buffer", "MiB", "at MiB", "from layer", "to layer"});
  const auto layer_name = [&](int index) {
    return index < report.layers_size() ? report.layers(index).name() : std::string("(end)");
  };
  for (const reports::Buffer& buffer : report.buffers())
    table.row({buffer.what(), mebi(buffer.bytes()), mebi(buffer.offset_bytes()),
               layer_name(buffer.first_layer()), layer_name(buffer.last_layer())});
  std::cout << "\nmemory plan:\n";
  table.print(std::cout);
}

void add_buffers(const engine::Plan& plan, reports::NetReport* report) {
  for (const engine::BufferUse& use : plan.buffers()) {
    reports::Buffer& buffer = *report->add_buffers();
    buffer.set_what(use.what);
    buffer.set_offset_bytes(static_cast<double>(use.offset_bytes));
    buffer.set_bytes(static_cast<double>(use.bytes));
    buffer.set_first_layer(static_cast<int>(use.first_layer));
    buffer.set_last_layer(static_cast<int>(use.last_layer));
  }
}

std::string instructions(engine::Precision precision) {
  const std::string simd = engine::simd_target(), bf16 = engine::bf16_instructions();
  if (precision == engine::Precision::kFloat32) return simd;
  return simd + (bf16.empty() ? " (no BF16: its products take longer than those of float32)"
                              : " with " + bf16);
}

reports::SpeedLimits message_of(const profiling::SpeedLimits& limits) {
  reports::SpeedLimits message;
  message.set_threads(limits.threads);
  message.set_float32_gflops(limits.float32_gflops);
  message.set_bf16_gflops(limits.bf16_gflops);
  for (const profiling::Bandwidth& bandwidth : limits.bandwidths) {
    reports::Bandwidth& out = *message.add_bandwidths();
    out.set_bytes(static_cast<double>(bandwidth.bytes));
    out.set_read(bandwidth.read);
    out.set_copied(bandwidth.copy);
  }
  return message;
}

void set_limits(const profiling::SpeedLimits& limits, const engine::LayerCost& cost,
                reports::NetLayer* layer) {
  const double median = layer->ms().median();
  if (median <= 0) return;
  const double compute = limits.compute_ms(cost), traffic = limits.traffic_ms(cost);
  if (cost.macs > 0) layer->set_peak_share(compute / median);
  layer->set_memory_share(traffic / median);
  layer->set_best_ms(std::max(compute, traffic));
}

void set_cost(const engine::LayerCost& cost, reports::NetLayer* layer) {
  layer->set_name(cost.name);
  layer->set_type(cost.type);
  layer->set_kernel(cost.kernel);
  layer->set_reason(cost.selection_reason);
  if (!cost.outputs.empty()) set_shape(cost.outputs[0], layer->mutable_output_shape());
  set_blobs(cost, layer);
  layer->set_macs(static_cast<double>(cost.macs));
  layer->set_multiplications(static_cast<double>(cost.multiplications));
  layer->set_read_bytes(static_cast<double>(cost.read_bytes));
  layer->set_written_bytes(static_cast<double>(cost.written_bytes));
  layer->set_parameters(static_cast<double>(cost.parameters));
  layer->set_packed_weight_bytes(static_cast<double>(cost.packed_weight_bytes));
  layer->set_activation_bytes(static_cast<double>(cost.activation_bytes));
  if (cost.field_h) *layer->mutable_field_h() = receptive_field(*cost.field_h);
  if (cost.field_w) *layer->mutable_field_w() = receptive_field(*cost.field_w);
}

}  // namespace

reports::NetReport net_report(const NetFindings& findings) {
  const auto& [options, weights, net, plan, with_buffers, profile, limits, resident] = findings;
  reports::NetReport report;
  report.set_net(net.name());
  report.set_prototxt(options.prototxt.string());
  report.set_weights(weights);
  if (std::error_code none; std::filesystem::is_regular_file(weights, none)) {
    const auto size = static_cast<double>(std::filesystem::file_size(weights, none));
    report.set_weight_file_bytes(size);
    // The index of a file is read twice.
    report.set_weight_bytes_read(std::min(static_cast<double>(net.weight_bytes_read()), size));
  }
  report.set_threads(options.threads);
  report.set_arena_bytes(static_cast<double>(plan.arena_bytes()));
  report.set_weight_bytes(static_cast<double>(plan.weight_bytes()));
  report.set_packed_weight_bytes(static_cast<double>(plan.packed_weight_bytes()));
  report.set_simd(instructions(options.precision));
  report.set_precision(options.precision == engine::Precision::kBf16 ? "bf16" : "float32");
  for (const engine::Port& port : plan.inputs())
    set_named_shape(port.name, port.shape, report.add_inputs());
  for (const engine::Port& port : plan.outputs())
    set_named_shape(port.name, port.shape, report.add_outputs());

  double macs = 0, parameters = 0, medians = 0, best = 0;
  if (profile)
    for (const profiling::Timing& t : profile->layers) medians += t.median;
  for (size_t i = 0; i < plan.layers().size(); ++i) {
    const engine::LayerCost& cost = plan.layers()[i];
    reports::NetLayer& layer = *report.add_layers();
    set_cost(cost, &layer);
    macs += layer.macs();
    parameters += layer.parameters();
    if (!profile) continue;
    *layer.mutable_ms() = timing(profile->layers[i]);
    layer.set_share(medians > 0 ? profile->layers[i].median / medians : 0);
    if (cost.macs > 0) layer.set_gflops(gflops(layer.macs(), profile->layers[i].median));
    if (limits) set_limits(*limits, cost, &layer);
    best += layer.best_ms();
  }
  report.set_macs(macs);
  report.set_parameters(parameters);
  if (profile) {
    *report.mutable_total_ms() = timing(profile->total);
    *report.mutable_layer_sum_ms() = timing(profile->layer_sum);
    report.set_passes(profile->passes);
    report.set_gflops(gflops(macs, profile->total.median));
    report.set_peak_resident_bytes(resident);
  }
  if (limits) {
    *report.mutable_limits() = message_of(*limits);
    report.set_best_ms(best);
  }
  if (with_buffers) add_buffers(plan, &report);
  return report;
}

void clear_limits_if_busy(reports::NetReport* report) {
  constexpr double kMaxShare = 1.1, kMinMs = 0.01;            // of layers
  constexpr double kMaxRatio = 1.5, kMinDifferenceMs = 0.05;  // of passes
  const double median = report->total_ms().median(), least = report->total_ms().min();
  if (median > kMaxRatio * least && median - least > kMinDifferenceMs)
    report->set_busy(str("the median pass took ", number(median, 3), " ms, the fastest ",
                         number(least, 3), " ms"));
  for (const reports::NetLayer& layer : report->layers())
    if (const double share = std::max(layer.peak_share(), layer.memory_share());
        share > kMaxShare && layer.ms().median() > kMinMs) {
      report->set_busy(str("layer '", layer.name(), "' took ", number(layer.ms().median(), 3),
                           " ms, less than the ", number(layer.best_ms(), 3),
                           " ms that the measured limits of the machine allow"));
      break;
    }
  if (!report->has_busy()) return;
  report->clear_limits();
  report->clear_best_ms();
  for (reports::NetLayer& layer : *report->mutable_layers()) {
    layer.clear_peak_share();
    layer.clear_memory_share();
    layer.clear_best_ms();
  }
}

void print_net_report(const reports::NetReport& report, const std::string& format) {
  if (format == "table")
    std::cout << "kernels: " << report.simd() << ", " << plural(report.threads(), "thread")
              << "\n\n";
  print_report(format, report, layer_table(report));
  if (format != "table") return;
  if (report.buffers_size() > 0) print_buffers(report);
  print_summary(report);
  if (report.has_baseline()) print_comparison(report);
}

}  // namespace revisit::cli

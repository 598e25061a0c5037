#include "studies/trade/outcome.h"

#include "base/json_reader.h"

#include <algorithm>
#include <boost/math/distributions/students_t.hpp>
#include <cmath>
#include <fmt/format.h>
#include <limits>

namespace haptrace {
namespace {

nlohmann::json json_of_estimate(const Estimate& estimate) {
  return {{"mean", json_of_number(estimate.mean)}, {"half_width", json_of_number(estimate.half_width)}};
}

const Estimate* estimate_of(const Outcome& outcome, Measure measure) {
  switch (measure) {
    case Measure::error:
      return &outcome.error;
    case Measure::peak:
      return &outcome.peak;
    case Measure::force:
      return &outcome.force;
    case Measure::ripple:
      return &outcome.ripple;
    default:
      return nullptr;
  }
}

}  // namespace

Estimate Estimate::of(const std::vector<double>& values) {
  if (values.empty()) return {};
  const auto n = static_cast<double>(values.size());
  double sum = 0;
  for (const double value : values) sum += value;
  Estimate estimate{.mean = sum / n};
  if (!std::isfinite(sum)) return {.mean = std::numeric_limits<double>::infinity()};
  if (values.size() < 2) {
    estimate.half_width = std::numeric_limits<double>::infinity();
    return estimate;
  }
  double squares = 0;
  for (const double value : values) squares += (value - estimate.mean) * (value - estimate.mean);
  const boost::math::students_t distribution(n - 1);
  estimate.half_width = boost::math::quantile(distribution, 0.975) * std::sqrt(squares / (n - 1) / n);
  return estimate;
}

const std::vector<MeasureFacts>& measures() {
  static const std::vector<MeasureFacts> all{
      {Measure::error, "error", "mm", 1e-3, true, true, "rms distance from the path"},
      {Measure::peak, "peak", "mm", 1e-3, true, true, "largest distance from the path"},
      {Measure::force, "force", "N", 1, true, true,
       "rms difference between the force and that of the finest configuration"},
      {Measure::ripple, "ripple", "N", 1, true, true, "rms of the force above 25 Hz"},
      {Measure::margin, "margin", "", 1, false, true,
       "factor by which the gains may be raised before the loop oscillates"},
      {Measure::tick, "tick", "us", 1e-6, true, false, "median time of a tick"},
      {Measure::instructions, "instructions", "", 1, true, false, "instructions per tick"},
      {Measure::load, "load", "MIPS", 1e6, true, false, "instructions per second"},
      {Measure::start, "start", "ms", 1e-3, true, false, "time from the path in memory to the first tick"},
      {Measure::bytes, "bytes", "MB/h", 1e6, true, false, "size of a recording"}};
  return all;
}

const MeasureFacts& facts_of(Measure measure) {
  return measures()[static_cast<std::size_t>(measure)];
}

double mean_of(const Outcome& outcome, Measure measure) {
  if (!outcome.ran()) return facts_of(measure).at_most ? std::numeric_limits<double>::infinity() : 0;
  if (const Estimate* estimate = estimate_of(outcome, measure)) return estimate->mean;
  switch (measure) {
    case Measure::margin:
      return outcome.margin;
    case Measure::tick:
      return outcome.tick;
    case Measure::instructions:
      return outcome.instructions;
    case Measure::load:
      return outcome.counted() ? outcome.load() : kNaN;
    case Measure::start:
      return outcome.start;
    default:
      return outcome.bytes_per_hour;
  }
}

double value_of(const Outcome& outcome, Measure measure) {
  const Estimate* estimate = estimate_of(outcome, measure);
  return mean_of(outcome, measure) + (estimate != nullptr && outcome.ran() ? estimate->half_width : 0);
}

std::string text_of(Measure measure, double value) {
  const MeasureFacts& facts = facts_of(measure);
  return fmt::format("{:.3g}{}{}", value / facts.scale, *facts.unit != 0 ? " " : "", facts.unit);
}

std::string text_of_load(const Outcome& outcome) {
  if (outcome.counted()) return text_of(Measure::load, outcome.load());
  return fmt::format("{:.3g} % of the time", 100 * 1e-9 * outcome.load());
}

nlohmann::json to_json(const Outcome& outcome) {
  nlohmann::json json{{"configuration", to_json(outcome.configuration)}, {"runs", outcome.runs}};
  if (!outcome.refused.empty()) json["refused"] = outcome.refused;
  json["error_m"] = json_of_estimate(outcome.error);
  json["peak_m"] = json_of_estimate(outcome.peak);
  json["rms_error_m"] = json_of_estimate(outcome.rms_error);
  json["peak_error_m"] = json_of_estimate(outcome.peak_error);
  json["force_error_n"] = json_of_estimate(outcome.force);
  json["force_ripple_n"] = json_of_estimate(outcome.ripple);
  json["max_force_n"] = json_of_estimate(outcome.max_force);
  json["margin"] = json_of_number(outcome.margin);
  json["tick_s"] = json_of_number(outcome.tick);
  json["control_s"] = json_of_number(outcome.control);
  json["instructions"] = json_of_number(outcome.instructions);
  json["load_per_s"] = json_of_number(mean_of(outcome, Measure::load));
  json["load_share_of_time"] = json_of_number(outcome.counted() ? kNaN : 1e-9 * outcome.load());
  json["start_s"] = json_of_number(outcome.start);
  json["duration_s"] = outcome.duration;
  json["bytes_per_hour"] = json_of_number(outcome.bytes_per_hour);
  return json;
}

}  // namespace haptrace

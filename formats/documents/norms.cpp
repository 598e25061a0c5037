#include "formats/documents/norms.h"

#include "base/error.h"
#include "base/json_reader.h"
#include "formats/documents/programme.h"

#include <algorithm>
#include <array>
#include <fmt/format.h>
#include <tuple>

namespace haptrace {
namespace {

std::string required_text(JsonReader& reader, const std::string& key) {
  std::string text = reader.require(key).text(key, "");
  if (text.empty()) throw input_error(fmt::format("{}: {}: must not be empty", reader.where(), key));
  return text;
}

std::optional<double> optional_number(JsonReader& reader, const std::string& key, double least) {
  return reader.has(key) ? std::optional(reader.number(key, 0, least)) : std::nullopt;
}

/// Reads [from, to].
std::pair<double, double> range(JsonReader& reader, const std::string& key) {
  const nlohmann::json value = reader.value(key);
  if (!value.is_array() || value.size() != 2 || !value[0].is_number() || !value[1].is_number() ||
      !(value[0].get<double>() <= value[1].get<double>()))
    throw input_error(fmt::format("{}: {}: expected [from, to] with from <= to", reader.where(), key));
  return {value[0].get<double>(), value[1].get<double>()};
}

std::vector<std::vector<double>> retest(JsonReader& reader) {
  const nlohmann::json value = reader.value("retest");
  if (value.is_null()) return {};
  const auto is_row = [&](const nlohmann::json& row) {
    return row.is_array() && row.size() >= 2 && row.size() == value.front().size() &&
           std::all_of(row.begin(), row.end(), [](const nlohmann::json& one) { return one.is_number(); });
  };
  constexpr std::size_t kFewest = 3;  // persons
  if (!value.is_array() || value.size() < kFewest || !std::all_of(value.begin(), value.end(), is_row))
    throw input_error(
        fmt::format("{}: retest: expected an array of at least {} persons, each an array of the same "
                    "number of sessions, two or more",
                    reader.where(), kFewest));
  return value.get<std::vector<std::vector<double>>>();
}

MetricNorm metric_from(JsonReader reader) {
  MetricNorm norm{.mdc95 = optional_number(reader, "mdc95", 0),
                  .sem = optional_number(reader, "sem", 0),
                  .sd = optional_number(reader, "sd", 0),
                  .icc = optional_number(reader, "icc", -1),
                  .retest = retest(reader)};
  if (reader.has("range")) std::tie(norm.low, norm.high) = range(reader, "range");
  reader.finish();
  for (const auto& [key, value] :
       {std::pair("mdc95", norm.mdc95), std::pair("sem", norm.sem), std::pair("sd", norm.sd)})
    if (value && !(*value > 0))
      throw input_error(fmt::format("{}: {} is 0, but every measurement has an error; give it, or leave it out",
                                    reader.where(), key));
  if (norm.icc && !(*norm.icc < 1))
    throw input_error(fmt::format("{}: icc is {:g}; it must be less than 1", reader.where(), *norm.icc));
  if (norm.sd.has_value() != norm.icc.has_value())
    throw input_error(reader.where() + ": sd and icc belong together; give both");
  const std::array<bool, 4> ways{norm.mdc95.has_value(), norm.sem.has_value(), norm.sd.has_value(),
                                 !norm.retest.empty()};
  if (std::count(ways.begin(), ways.end(), true) > 1)
    throw input_error(reader.where() + ": states the error twice; give one of mdc95, sem, sd with icc, or retest");
  if (std::count(ways.begin(), ways.end(), true) == 0 && !norm.low && !norm.high)
    throw input_error(reader.where() +
                      ": states nothing; give its error (mdc95, sem, sd with icc, or retest) or a range");
  return norm;
}

}  // namespace

Norms load_norms(const std::string& file) {
  std::vector<std::string> modes = exercise_modes();
  modes.insert(modes.end(), {"playback", "recording"});
  constexpr int kFormat = 1;
  const nlohmann::json document = load_json(file);
  JsonReader reader(document, file);
  reader.require("haptrace_norms").integer("haptrace_norms", kFormat, kFormat, kFormat);
  Norms norms{.file = file,
              .source = required_text(reader, "source"),
              .population = reader.text("population", ""),
              .device = required_text(reader, "device"),
              .task = required_text(reader, "task"),
              .mode = reader.require("mode").choice("mode", "free", modes)};
  std::tie(norms.age_from, norms.age_to) = range(reader.require("age"), "age");
  std::optional<JsonReader> metrics = reader.require("metrics").object("metrics");
  for (const auto& [name, value] : document.at("metrics").items())
    norms.metrics.emplace(name, metric_from(metrics->object(name).value()));
  reader.finish();
  return norms;
}

}  // namespace haptrace

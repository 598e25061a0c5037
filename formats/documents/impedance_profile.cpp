#include "formats/documents/impedance_profile.h"

#include "base/error.h"
#include "base/json_reader.h"
#include "base/text_file.h"
#include "formats/path/csv_header.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <functional>
#include <optional>

namespace haptrace {
namespace {

constexpr double kDerivativeTime = 0.012;  // kd / kp without kd [s], that of cautious_gains
constexpr double kFarthest = 1e9;          // [s] or [m]

Vec3 derivative_of(const Vec3& kp) {
  return (kDerivativeTime * kp).cwiseMin(kLargestKd);
}

std::vector<double> places_of(JsonReader& reader, const std::string& key) {
  const nlohmann::json value = reader.value(key);
  std::vector<double> places;
  if (value.is_array())
    for (const nlohmann::json& one : value)
      if (one.is_number() && std::abs(one.get<double>()) <= kFarthest) places.push_back(one.get<double>());
  if (!value.is_array() || value.empty() || places.size() != value.size())
    throw input_error(fmt::format("{}: {}: expected an array of numbers", reader.where(), key));
  return places;
}

std::vector<Vec3> gains_of(JsonReader& reader, const std::string& key, std::size_t count, double largest) {
  const nlohmann::json value = reader.value(key);
  if (!value.is_array() || value.size() != count)
    throw input_error(
        fmt::format("{}: {}: expected an array of {} gains, one for each place", reader.where(), key, count));
  std::vector<Vec3> gains;
  for (std::size_t i = 0; i < count; ++i) {
    const nlohmann::json one{{"gain", value[i]}};
    JsonReader gain(one, fmt::format("{}: {}[{}]", reader.where(), key, i));
    gains.push_back(gain.vector("gain", Vec3::Zero(), 0, largest));
  }
  return gains;
}

ImpedanceProfile from_json(const std::string& file) {
  const nlohmann::json document = load_json(file);
  JsonReader reader(document, file);
  ImpedanceProfile profile{.by_place = reader.has("s")};
  if (profile.by_place == reader.has("t"))
    throw input_error(fmt::format("{}: give either s, places along the path [m], or t, times [s]", file));
  profile.at = places_of(reader, profile.by_place ? "s" : "t");
  reader.require("kp");
  const std::vector<Vec3> kp = gains_of(reader, "kp", profile.at.size(), kLargestKp);
  std::vector<Vec3> kd;
  if (reader.has("kd")) kd = gains_of(reader, "kd", profile.at.size(), kLargestKd);
  reader.finish();
  for (std::size_t i = 0; i < kp.size(); ++i)
    profile.gains.push_back({kp[i], kd.empty() ? derivative_of(kp[i]) : kd[i]});
  return profile;
}

/// Finds the columns of a gain: one for all axes, or one per axis. Returns nothing if there is none.
std::optional<std::array<std::size_t, 3>> gain_columns(const std::vector<std::string>& names, const std::string& name) {
  const auto column = [&](const std::string& wanted) {
    return static_cast<std::size_t>(std::find(names.begin(), names.end(), wanted) - names.begin());
  };
  std::array<std::size_t, 3> columns{column(name + "x"), column(name + "y"), column(name + "z")};
  if (std::all_of(columns.begin(), columns.end(), [&](std::size_t c) { return c < names.size(); })) return columns;
  columns.fill(column(name));
  return columns.front() < names.size() ? std::optional(columns) : std::nullopt;
}

ImpedanceProfile from_csv(const std::string& file) {
  LineReader lines(file, "a profile of gains as CSV");
  std::string_view line;
  const auto next = [&] {
    while (lines.next(line))
      if (const std::string_view text = trim(line); !text.empty() && text.front() != '#' && text.front() != '%')
        return true;
    return false;
  };
  std::vector<std::string> names;
  if (next()) split_csv(line, ',', [&](std::size_t, std::string_view name, bool) { names.emplace_back(name); });
  const auto time = std::find(names.begin(), names.end(), "t"), place = std::find(names.begin(), names.end(), "s");
  ImpedanceProfile profile{.by_place = time == names.end()};
  const auto at_column = static_cast<std::size_t>((profile.by_place ? place : time) - names.begin());
  const auto kp = gain_columns(names, "kp"), kd = gain_columns(names, "kd");
  if (at_column == names.size() || !kp)
    throw input_error(
        fmt::format("{}: a profile of gains needs a column t [s] or s [m], and kp or kpx,kpy,kpz [N/m]; "
                    "the header names {}",
                    file, shown(fmt::format("{}", fmt::join(names, ", ")))));
  std::vector<double> cells;
  while (next()) {
    cells.clear();
    split_csv(line, ',', [&](std::size_t, std::string_view field, bool) {
      double value = kNaN;
      // An empty field, and text in a column that is not read, is no number.
      if (!parse_number(field, value)) value = kNaN;
      cells.push_back(value);
    });
    if (cells.size() != names.size())
      throw lines.error(fmt::format("{} columns, but the header names {}", cells.size(), names.size()));
    const auto vector = [&](const std::array<std::size_t, 3>& columns) {
      return Vec3(cells[columns[0]], cells[columns[1]], cells[columns[2]]);
    };
    PdGains gains{.kp = vector(*kp)};
    gains.kd = kd ? vector(*kd) : derivative_of(gains.kp);
    if (gains.kp.array().isNaN().any() || gains.kd.array().isNaN().any()) continue;
    if (!(std::abs(cells[at_column]) <= kFarthest))
      throw lines.error(fmt::format("{} is not a number", names[at_column]));
    try {
      validate(gains);
    } catch (const Error& error) {
      throw lines.error(error.what());
    }
    profile.at.push_back(cells[at_column]);
    profile.gains.push_back(gains);
  }
  if (profile.at.empty()) throw input_error(fmt::format("{}: no row states a gain", file));
  return profile;
}

}  // namespace

PdGains ImpedanceProfile::gains_at(double place) const {
  const auto next = std::upper_bound(at.begin(), at.end(), place);
  if (next == at.begin()) return gains.front();
  if (next == at.end()) return gains.back();
  const auto i = static_cast<std::size_t>(next - at.begin());
  const double share = (place - at[i - 1]) / (at[i] - at[i - 1]);
  const PdGains &a = gains[i - 1], &b = gains[i];
  return {a.kp + share * (b.kp - a.kp), a.kd + share * (b.kd - a.kd)};
}

ImpedanceProfile load_impedance_profile(const std::string& file) {
  ImpedanceProfile profile = file_ending(file) == ".csv" ? from_csv(file) : from_json(file);
  const auto stuck = std::adjacent_find(profile.at.begin(), profile.at.end(), std::greater_equal<>());
  if (stuck != profile.at.end())
    throw input_error(fmt::format("{}: {}: {} does not come after {}; {} must increase", file,
                                  profile.by_place ? "s" : "t", *(stuck + 1), *stuck, profile.by_place ? "s" : "t"));
  return profile;
}

}  // namespace haptrace

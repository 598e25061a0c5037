#include "formats/documents/radius_profile.h"

#include "base/error.h"
#include "base/json_reader.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace haptrace {
namespace {

std::vector<double> lengths_of(JsonReader& reader, const std::string& key, double most) {
  const nlohmann::json value = reader.require(key).value(key);
  std::vector<double> lengths;
  const auto is_length = [most](const nlohmann::json& one) {
    return one.is_number() && one.get<double>() >= 0 && one.get<double>() <= most;
  };
  if (!value.is_array() || value.empty() || !std::all_of(value.begin(), value.end(), is_length))
    throw input_error(fmt::format("{}: {}: expected an array of lengths from 0 to {} m", reader.where(), key, most));
  return value.get<std::vector<double>>();
}

}  // namespace

double RadiusProfile::at(double place) const {
  const auto next = std::upper_bound(s.begin(), s.end(), place);
  if (next == s.begin()) return radius.front();
  if (next == s.end()) return radius.back();
  const auto i = static_cast<std::size_t>(next - s.begin());
  return std::lerp(radius[i - 1], radius[i], (place - s[i - 1]) / (s[i] - s[i - 1]));
}

RadiusProfile load_radius_profile(const std::string& file) {
  constexpr double kLongest = 1e5, kWidest = 1;  // [m]
  const nlohmann::json document = load_json(file);
  JsonReader reader(document, file);
  RadiusProfile profile{.s = lengths_of(reader, "s", kLongest), .radius = lengths_of(reader, "radius", kWidest)};
  reader.finish();
  if (profile.s.size() != profile.radius.size())
    throw input_error(fmt::format("{}: s has {} values and radius has {}; give one radius for each s", file,
                                  profile.s.size(), profile.radius.size()));
  const auto stuck = std::adjacent_find(profile.s.begin(), profile.s.end(), std::greater_equal<>());
  if (stuck != profile.s.end())
    throw input_error(fmt::format("{}: s[{}]: {} does not come after {}; s must increase", file,
                                  stuck - profile.s.begin() + 1, *(stuck + 1), *stuck));
  return profile;
}

}  // namespace haptrace

#include "base/units.h"

#include "base/number.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <fmt/format.h>
#include <numbers>

namespace haptrace {
namespace {

constexpr auto kKnownUnits = std::to_array<Unit>({
    {"s", "s", 1},
    {"sec", "s", 1},
    {"secs", "s", 1},
    {"second", "s", 1},
    {"seconds", "s", 1},
    {"sek", "s", 1},
    {"ms", "s", 1e3},
    {"msec", "s", 1e3},
    {"msecs", "s", 1e3},
    {"millis", "s", 1e3},
    {"millisecond", "s", 1e3},
    {"milliseconds", "s", 1e3},
    {"us", "s", 1e6},
    {"usec", "s", 1e6},
    {"usecs", "s", 1e6},
    {"micros", "s", 1e6},
    {"microsecond", "s", 1e6},
    {"microseconds", "s", 1e6},
    {"ns", "s", 1e9},
    {"nsec", "s", 1e9},
    {"nsecs", "s", 1e9},
    {"nanosecond", "s", 1e9},
    {"nanoseconds", "s", 1e9},
    {"min", "s", 1.0 / 60},
    {"minutes", "s", 1.0 / 60},
    {"m", "m", 1},
    {"meter", "m", 1},
    {"meters", "m", 1},
    {"metre", "m", 1},
    {"metres", "m", 1},
    {"mm", "m", 1e3},
    {"millimeter", "m", 1e3},
    {"millimeters", "m", 1e3},
    {"millimetre", "m", 1e3},
    {"millimetres", "m", 1e3},
    {"cm", "m", 1e2},
    {"centimeter", "m", 1e2},
    {"centimeters", "m", 1e2},
    {"centimetre", "m", 1e2},
    {"centimetres", "m", 1e2},
    {"um", "m", 1e6},
    {"micron", "m", 1e6},
    {"microns", "m", 1e6},
    {"micrometer", "m", 1e6},
    {"micrometers", "m", 1e6},
    {"micrometre", "m", 1e6},
    {"micrometres", "m", 1e6},
    {"in", "m", 1 / 0.0254},
    {"inch", "m", 1 / 0.0254},
    {"inches", "m", 1 / 0.0254},
    {"m/s", "m/s", 1},
    {"mps", "m/s", 1},
    {"mm/s", "m/s", 1e3},
    {"cm/s", "m/s", 1e2},
    {"um/s", "m/s", 1e6},
    {"in/s", "m/s", 1 / 0.0254},
    {"n", "N", 1},
    {"newton", "N", 1},
    {"newtons", "N", 1},
    {"mn", "N", 1e3},
    {"millinewton", "N", 1e3},
    {"millinewtons", "N", 1e3},
    {"nm", "N m", 1},
    {"mnm", "N m", 1e3},
    {"nmm", "N m", 1e3},
});

/// Units that appear in options, but not in the header of a file.
constexpr auto kOptionUnits = std::to_array<Unit>({
    {"h", "s", 1.0 / 3600},
    {"hz", "Hz", 1},
    {"khz", "Hz", 1e-3},
    {"n/m", "N/m", 1},
    {"kn/m", "N/m", 1e-3},
    {"n/mm", "N/m", 1e-3},
    {"ns/m", "N s/m", 1},
    {"rad", "rad", 1},
    {"deg", "rad", 180 / std::numbers::pi},
    {"kg", "kg", 1},
    {"g", "kg", 1e3},
    {"j", "J", 1},
    {"mj", "J", 1e3},
    {"nm/rad", "N m/rad", 1},
    {"nms/rad", "N m s/rad", 1},
});

}  // namespace

std::string bracketed_unit(std::string_view description) {
  for (std::size_t at = 0; (at = description.find('[', at)) != std::string_view::npos; ++at) {
    const std::size_t end = description.find(']', at);
    if (end == std::string_view::npos) break;
    const std::string_view unit = description.substr(at + 1, end - at - 1);
    for (const std::span<const Unit> known : {std::span<const Unit>(kKnownUnits), std::span<const Unit>(kOptionUnits)})
      for (const Unit& candidate : known)
        if (candidate.si == unit) return std::string(unit);
  }
  return "";
}

std::optional<double> parse_quantity(std::string_view text, std::string_view si) {
  const std::optional<double> number = take_number<double>(text);
  if (!number || !std::isfinite(*number)) return std::nullopt;
  if (text.find_first_not_of(' ') == std::string_view::npos) return number;
  std::string name(text);
  std::erase(name, ' ');
  const Unit* unit = find_unit(text, si);
  for (const Unit& candidate : kOptionUnits)
    if (candidate.si == si && candidate.name == lower_case(name)) unit = &candidate;
  // An M is mega, a billion times a milli. Only whole words, as Millimetres, have no other meaning.
  constexpr std::size_t kLongestSymbol = 4;
  const bool mega = name.starts_with('M') && name.size() <= kLongestSymbol && unit != nullptr && unit->per_si == 1e3;
  return unit != nullptr && !mega ? std::optional(*number / unit->per_si) : std::nullopt;
}

std::span<const Unit> units() {
  return kKnownUnits;
}

std::string duration_text(double seconds) {
  if (seconds < 1e-3) return fmt::format("{:.3g} us", 1e6 * seconds);
  return seconds < 1 ? fmt::format("{:.3g} ms", 1e3 * seconds) : fmt::format("{:.3g} s", seconds);
}

std::string long_duration_text(double seconds, std::string_view space) {
  if (seconds < 100) return fmt::format("{:.{}f}{}s", seconds, seconds < 10 ? 1 : 0, space);
  if (seconds >= 36'000) return fmt::format("{:.0f}{}h", seconds / 3600, space);
  const long minutes = std::lround(seconds / 60);
  if (minutes < 100) return fmt::format("{}{}min", minutes, space);
  const std::string hours = fmt::format("{}{}h", minutes / 60, space);
  return minutes % 60 == 0 ? hours : fmt::format("{} {}{}min", hours, minutes % 60, space);
}

std::string lower_case(std::string_view text) {
  std::string result;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const auto c = static_cast<unsigned char>(text[i]);
    const auto next = i + 1 < text.size() ? static_cast<unsigned char>(text[i + 1]) : 0U;
    if ((c == 0xC2 && next == 0xB5) || (c == 0xCE && next == 0xBC)) {  // U+00B5, U+03BC
      result += 'u';
      ++i;
    } else {
      result += c == 0xB5 ? 'u' : static_cast<char>(c < 0x80 ? std::tolower(c) : c);
    }
  }
  return result;
}

const Unit* find_unit(std::string_view text, std::string_view si) {
  std::string name = lower_case(text);
  for (const char* dot : {"\xC2\xB7", "\xE2\x8B\x85"})  // between N and m
    if (const std::size_t at = name.find(dot); at != std::string::npos) name.erase(at, std::string_view(dot).size());
  std::erase_if(name, [](char c) { return std::string_view(" \t.*[](){}\"'").find(c) != std::string_view::npos; });
  if (name == "ms^-1" || name == "ms-1") name = "m/s";
  const auto fits = [&](const Unit& unit) {
    return unit.name == name && (si.empty() ? unit.name != "nm" : unit.si == si);
  };
  const auto* const found = std::find_if(kKnownUnits.begin(), kKnownUnits.end(), fits);
  if (found == kKnownUnits.end()) return nullptr;
  return std::find_if(kKnownUnits.begin(), kKnownUnits.end(),
                      [&](const Unit& unit) { return unit.si == found->si && unit.per_si == found->per_si; });
}

}  // namespace haptrace

// Reading and writing of JSON files. The reader is strict: a key that the program does not ask for is an error, and
// errors name the path of the key.
#pragma once

#include "base/types.h"

#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace haptrace {

/// Returns the whole text of a JSON file. Throws Error(input) if it cannot be read.
std::string load_text(const std::string& file);

/// Reads a JSON file (comments allowed). Throws Error(input) with file, line and column, or with the name of a key that
/// an object has twice.
nlohmann::json load_json(const std::string& file);

/// Parses text from `where` (an option, a dataset). Throws Error(input), also if it nests deeper than 100 levels.
nlohmann::json parse_json(const std::string& text, const std::string& where);

/// Writes `json` with indentation. The file appears under its name only when it is complete. Throws Error(input) if the
/// file exists (unless `overwrite`) or cannot be written.
void save_json(const nlohmann::json& json, const std::string& file, bool overwrite);

/// Returns a JSON number, or null if the value is not finite.
inline nlohmann::json json_of_number(double value) {
  return std::isfinite(value) ? nlohmann::json(value) : nlohmann::json(nullptr);
}

/// Returns a JSON number, or null if there is no value or it is not finite.
inline nlohmann::json json_of_number(const std::optional<double>& value) {
  return value ? json_of_number(*value) : nlohmann::json(nullptr);
}

/// Returns [x, y, z], a form that JsonReader::vector reads.
inline nlohmann::json json_of(const Vec3& v) {
  return {v.x(), v.y(), v.z()};
}

/// Returns a text of `object`, such as the configuration of a recording; `otherwise` if the key is absent, has another
/// type, or `object` is no object.
std::string text_in(const nlohmann::json& object, const char* key, const std::string& otherwise = "");

/// Returns a number in the same way, or nothing.
std::optional<double> number_in(const nlohmann::json& object, const char* key);

/// Reads one JSON object. Ask for every key, then call finish().
///
/// Every getter throws Error(input) if the value has another type or is out of range. The message names the path of the
/// key, as in "my.json: hand.mass[1]: ...". null counts as a value of another type, not as an absent key.
class JsonReader {
 public:
  /// `where` names the object in errors, for example "my.json". `object` must outlive the reader.
  JsonReader(const nlohmann::json& object, std::string where);

  /// Returns whether the key is there. Errors may suggest it.
  [[nodiscard]] bool has(const std::string& key);
  /// Returns this reader. Throws Error(input) if the key is absent.
  JsonReader& require(const std::string& key);

  /// Returns the value, or `fallback` if the key is absent. Numbers must be finite and within [min, max].
  double number(const std::string& key, double fallback, double min = -1e300, double max = 1e300);
  /// Reads a length [m]: a number, or a text of a number and one of the units m, mm, cm, um and in, as "1mm".
  double length(const std::string& key, double fallback, double min, double max);
  /// Reads one number for all three axes, or an array of three.
  Vec3 vector(const std::string& key, const Vec3& fallback, double min = -1e300, double max = 1e300);
  /// Reads an array of three numbers, a direction that has a length, as a unit vector.
  Vec3 direction(const std::string& key, const Vec3& fallback);
  /// Reads a list of 1 to `most` numbers.
  std::vector<double> numbers(const std::string& key, std::vector<double> fallback, std::size_t most,
                              double min = -1e300, double max = 1e300);
  int integer(const std::string& key, int fallback, int min, int max);
  bool boolean(const std::string& key, bool fallback);
  std::string text(const std::string& key, const std::string& fallback);
  /// Reads a text that must be in `known`; the error suggests the nearest known text.
  std::string choice(const std::string& key, const std::string& fallback, std::span<const std::string> known);
  /// Returns any value, for another function to parse; null if the key is absent.
  nlohmann::json value(const std::string& key);
  /// Returns a reader of a nested object, if the key is present.
  std::optional<JsonReader> object(const std::string& key);
  /// Returns readers for an array of objects; none if the key is absent. Errors name the index, as in "my.json:
  /// trials[2].mode".
  std::vector<JsonReader> objects(const std::string& key);

  /// Throws Error(input) for the first key that the program has not asked for, and suggests the nearest known key.
  void finish() const;

  [[nodiscard]] const std::string& where() const noexcept { return where_; }

 private:
  JsonReader(const nlohmann::json& object, std::string where, const char* separator);
  [[nodiscard]] bool is_asked(const std::string& key) const;
  const nlohmann::json* find(const std::string& key);

  const nlohmann::json* object_;
  std::string where_;
  std::string prefix_;                 ///< prefix of a key in errors: "my.json: " or "my.json: hand."
  std::map<std::string, bool> known_;  ///< keys that the program knows; false if it only looked whether one is there
};

}  // namespace haptrace

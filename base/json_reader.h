// JSON files, and strict reading of them: every key is asked for, every other key is an error, and errors name the
// key's path.
#pragma once

#include "base/types.h"

#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

namespace haptrace {

/// Reads a JSON file (comments allowed). Throws Error(input) with file, line and column, or naming a key that an object
/// has twice.
nlohmann::json load_json(const std::string& file);

/// Parses text that came from `where` (an option, a dataset), nested no deeper than 100 levels. Throws Error(input).
nlohmann::json parse_json(const std::string& text, const std::string& where);

/// Writes `json` for people, who may find it under its name only when it is complete. Throws Error(input): the file
/// exists (unless `overwrite`) or cannot be written.
void save_json(const nlohmann::json& json, const std::string& file, bool overwrite);

/// Null when it is not finite.
inline nlohmann::json json_of_number(double value) {
  return std::isfinite(value) ? nlohmann::json(value) : nlohmann::json(nullptr);
}

/// [x, y, z], as JsonReader::vector reads it.
inline nlohmann::json json_of(const Vec3& v) {
  return {v.x(), v.y(), v.z()};
}

/// One JSON object being read. Ask for every key, then call finish().
///
/// Every question throws Error(input) naming the key's path, as in "my.json: hand.mass[1]: ...", when the value is of
/// another type or outside its range; null is not "absent" but a value of another type.
class JsonReader {
 public:
  /// `where` names the object in errors, for example "my.json". `object` must outlive the reader.
  JsonReader(const nlohmann::json& object, std::string where);

  [[nodiscard]] bool has(const std::string& key) const;
  /// This reader. Throws Error(input) when the key is absent.
  JsonReader& require(const std::string& key);

  /// The value, or `fallback` when the key is absent. Numbers must be finite and inside [min, max].
  double number(const std::string& key, double fallback, double min = -1e300, double max = 1e300);
  /// One number for all three axes, or an array of three.
  Vec3 vector(const std::string& key, const Vec3& fallback, double min = -1e300, double max = 1e300);
  int integer(const std::string& key, int fallback, int min, int max);
  bool boolean(const std::string& key, bool fallback);
  std::string text(const std::string& key, const std::string& fallback);
  /// A text of the list; an error suggests the nearest.
  std::string choice(const std::string& key, const std::string& fallback, std::span<const std::string> known);
  /// Any value, for somebody else to read; null when absent.
  nlohmann::json value(const std::string& key);
  /// A nested object, if present.
  std::optional<JsonReader> object(const std::string& key);
  /// An array of objects, none when absent; each names its place in errors, as in "my.json: trials[2].mode".
  std::vector<JsonReader> objects(const std::string& key);

  /// Throws Error(input) naming the first key nobody asked for, with the nearest that was.
  void finish() const;

  [[nodiscard]] const std::string& where() const noexcept { return where_; }

 private:
  JsonReader(const nlohmann::json& object, std::string where, const char* separator);
  const nlohmann::json* find(const std::string& key);

  const nlohmann::json* object_;
  std::string where_;
  std::string prefix_;  ///< what stands before a key in errors: "my.json: " or "my.json: hand."
  std::set<std::string> asked_;
};

}  // namespace haptrace

#include "base/json_reader.h"

#include "base/error.h"
#include "base/printable.h"
#include "base/suggest.h"
#include "base/text_file.h"
#include "base/units.h"
#include "base/vectors.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>
#include <iterator>
#include <set>
#include <string_view>
#include <vector>

namespace haptrace {
namespace {

using nlohmann::json;

/// Returns a JSON value as text, shortened to fit one line.
std::string shown_json(const json& value) {
  constexpr std::size_t kLongest = 40;
  std::string text = value.dump(-1, ' ', false, json::error_handler_t::replace);
  if (text.size() > kLongest) text = std::string(utf8_prefix(text, kLongest)) + "...";
  return text;
}

[[noreturn]] void wrong_type(const std::string& name, std::string_view expected, const json& value) {
  const bool quantity = value.is_string() && expected.find("number") != std::string_view::npos;
  throw input_error(fmt::format("{}: expected {}, found {}{}", name, expected, shown_json(value),
                                quantity ? "; numbers in JSON are SI, without quotes and units" : ""));
}

double checked_number(const json& value, const std::string& name, const char* expected, double min, double max) {
  if (!value.is_number()) wrong_type(name, expected, value);
  const double number = value.get<double>();
  if (!std::isfinite(number)) throw input_error(fmt::format("{}: {} is not a finite number", name, number));
  if (number < min) throw input_error(fmt::format("{}: {} is too small; the minimum is {}", name, number, min));
  if (number > max) throw input_error(fmt::format("{}: {} is too large; the maximum is {}", name, number, max));
  return number;
}

/// Returns nlohmann's message without the exception class: "line 3, column 7: syntax error ...".
std::string reason(const json::exception& error) {
  const std::string_view what = error.what();
  for (const std::string_view prefix : {"parse error at ", "] "})
    if (const auto at = what.find(prefix); at != std::string_view::npos)
      return std::string(what.substr(at + prefix.size()));
  return std::string(what);
}

/// Returns null if `object` has no such key, or is no object.
const json* find_in(const json& object, const char* key) {
  if (!object.is_object()) return nullptr;
  const auto found = object.find(key);
  return found != object.end() ? &*found : nullptr;
}

}  // namespace

std::string text_in(const json& object, const char* key, const std::string& otherwise) {
  const json* found = find_in(object, key);
  return found != nullptr && found->is_string() ? found->get<std::string>() : otherwise;
}

std::optional<double> number_in(const json& object, const char* key) {
  const json* found = find_in(object, key);
  return found != nullptr && found->is_number() ? std::optional(found->get<double>()) : std::nullopt;
}

json parse_json(const std::string& text, const std::string& where) {
  constexpr int kDeepest = 100;             // nlohmann copies and prints its values recursively
  std::vector<std::set<std::string>> keys;  // keys of the open objects
  const auto refuse = [&](int depth, json::parse_event_t event, const json& parsed) {
    if (depth > kDeepest) throw input_error(fmt::format("{}: is nested deeper than {} levels", where, kDeepest));
    if (event == json::parse_event_t::object_start) keys.emplace_back();
    if (event == json::parse_event_t::object_end) keys.pop_back();
    if (event == json::parse_event_t::key && !keys.back().insert(parsed.get<std::string>()).second)
      throw input_error(fmt::format("{}: key '{}' appears twice in one object", where, parsed.get<std::string>()));
    return true;
  };
  try {
    return json::parse(text, refuse, true, true);
  } catch (const json::exception& error) {
    throw input_error(fmt::format("{}: {}", where, reason(error)));
  }
}

std::string load_text(const std::string& file) {
  std::error_code ignored;
  if (std::filesystem::is_directory(file, ignored)) throw input_error(file + ": is a folder, not a JSON file");
  std::ifstream stream(file, std::ios::binary);
  std::string text{std::istreambuf_iterator<char>(stream), {}};
  if (!stream) throw input_error(fmt::format("{}: cannot be read: {}", file, std::strerror(errno)));
  return text;
}

json load_json(const std::string& file) {
  return parse_json(load_text(file), file);
}

void save_json(const json& json, const std::string& file, bool overwrite) {
  TextWriter writer(file, overwrite);
  // Replace bytes that are not UTF-8, so that the rest of the text is saved.
  writer.text() = json.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) + '\n';
  writer.commit();
}

JsonReader::JsonReader(const json& object, std::string where) : JsonReader(object, std::move(where), ": ") {}

JsonReader::JsonReader(const json& object, std::string where, const char* separator)
    : object_(&object), where_(std::move(where)), prefix_(where_ + separator) {
  if (!object.is_object()) wrong_type(where_, "an object", object);
}

bool JsonReader::has(const std::string& key) {
  known_.try_emplace(key, false);
  return object_->contains(key);
}

JsonReader& JsonReader::require(const std::string& key) {
  if (has(key)) return *this;
  std::vector<std::string> unknown;
  for (const auto& [name, value] : object_->items())
    if (!is_asked(name)) unknown.push_back(name);
  const std::string typo = nearest(key, unknown);
  throw input_error(fmt::format("{}: '{}' is missing{}", where_, key,
                                typo.empty() ? "" : fmt::format("; is '{}' meant to be it?", typo)));
}

bool JsonReader::is_asked(const std::string& key) const {
  const auto found = known_.find(key);
  return found != known_.end() && found->second;
}

const json* JsonReader::find(const std::string& key) {
  known_[key] = true;
  const auto found = object_->find(key);
  return found != object_->end() ? &*found : nullptr;
}

double JsonReader::number(const std::string& key, double fallback, double min, double max) {
  const json* value = find(key);
  return value != nullptr ? checked_number(*value, prefix_ + key, "a number", min, max) : fallback;
}

double JsonReader::length(const std::string& key, double fallback, double min, double max) {
  constexpr std::array<std::string_view, 5> kUnits{"m", "mm", "cm", "um", "in"};
  const json* value = find(key);
  if (value == nullptr) return fallback;
  const std::string name = prefix_ + key;
  if (!value->is_string()) return checked_number(*value, name, "a number", min, max);
  const std::string text = value->get<std::string>();
  const std::string unit = text.substr(text.find_last_of("0123456789. ") + 1);
  const bool known = std::find(kUnits.begin(), kUnits.end(), unit) != kUnits.end();
  const std::optional<double> metres = known ? parse_quantity(text, "m") : std::nullopt;
  if (!metres)
    throw input_error(
        fmt::format("{}: expected a length, found {}; give a number in metres, or a text with one of the "
                    "units {}, as \"1mm\"",
                    name, shown_json(*value), fmt::join(kUnits, ", ")));
  return checked_number(*metres, name, "a number", min, max);
}

Vec3 JsonReader::vector(const std::string& key, const Vec3& fallback, double min, double max) {
  constexpr const char* kExpected = "a number or an array of three numbers";
  const json* value = find(key);
  if (value == nullptr) return fallback;
  const std::string name = prefix_ + key;
  if (!value->is_array()) return Vec3::Constant(checked_number(*value, name, kExpected, min, max));
  if (value->size() != 3) wrong_type(name, kExpected, *value);
  Vec3 result;
  for (int axis = 0; axis < 3; ++axis)
    result[axis] = checked_number((*value)[static_cast<std::size_t>(axis)], fmt::format("{}[{}]", name, axis),
                                  "a number", min, max);
  return result;
}

Vec3 JsonReader::direction(const std::string& key, const Vec3& fallback) {
  if (const json* value = find(key); value != nullptr && !value->is_array())
    wrong_type(prefix_ + key, "an array of three numbers", *value);
  return direction_of(vector(key, fallback, -1, 1), prefix_ + key);
}

std::vector<double> JsonReader::numbers(const std::string& key, std::vector<double> fallback, std::size_t most,
                                        double min, double max) {
  const json* value = find(key);
  if (value == nullptr) return fallback;
  const std::string name = prefix_ + key;
  if (!value->is_array() || value->empty() || value->size() > most)
    wrong_type(name, fmt::format("a list of 1 to {} numbers", most), *value);
  std::vector<double> result;
  for (const json& number : *value)
    result.push_back(checked_number(number, fmt::format("{}[{}]", name, result.size()), "a number", min, max));
  return result;
}

int JsonReader::integer(const std::string& key, int fallback, int min, int max) {
  const json* value = find(key);
  if (value == nullptr) return fallback;
  const double number = checked_number(*value, prefix_ + key, "a whole number", min, max);
  if (number != std::floor(number)) wrong_type(prefix_ + key, "a whole number", *value);
  return static_cast<int>(number);
}

bool JsonReader::boolean(const std::string& key, bool fallback) {
  const json* value = find(key);
  if (value == nullptr) return fallback;
  if (!value->is_boolean()) wrong_type(prefix_ + key, "true or false", *value);
  return value->get<bool>();
}

std::string JsonReader::text(const std::string& key, const std::string& fallback) {
  const json* value = find(key);
  if (value == nullptr) return fallback;
  if (!value->is_string()) wrong_type(prefix_ + key, "text in quotes", *value);
  return value->get<std::string>();
}

std::string JsonReader::choice(const std::string& key, const std::string& fallback,
                               std::span<const std::string> known) {
  std::string word = text(key, fallback);
  if (std::find(known.begin(), known.end(), word) == known.end())
    throw input_error(fmt::format("{}{}: '{}' is not known{}", prefix_, key, word, suggestion(word, known)));
  return word;
}

json JsonReader::value(const std::string& key) {
  const json* value = find(key);
  return value != nullptr ? *value : json(nullptr);
}

std::optional<JsonReader> JsonReader::object(const std::string& key) {
  const json* value = find(key);
  if (value == nullptr) return std::nullopt;
  return JsonReader(*value, prefix_ + key, ".");
}

std::vector<JsonReader> JsonReader::objects(const std::string& key) {
  const json* value = find(key);
  if (value == nullptr) return {};
  if (!value->is_array()) wrong_type(prefix_ + key, "an array of objects", *value);
  std::vector<JsonReader> readers;
  for (std::size_t i = 0; i < value->size(); ++i)
    readers.push_back(JsonReader((*value)[i], fmt::format("{}{}[{}]", prefix_, key, i), "."));
  return readers;
}

void JsonReader::finish() const {
  for (const auto& item : object_->items()) {
    if (is_asked(item.key())) continue;
    std::vector<std::string> known;
    for (const auto& [key, asked] : known_) known.push_back(key);
    throw input_error(fmt::format("{}: key '{}' is not known{}", where_, item.key(), suggestion(item.key(), known)));
  }
}

}  // namespace haptrace

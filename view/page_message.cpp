#include "view/page_message.h"

#include "base/enum_names.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

namespace haptrace {
namespace {

constexpr std::size_t kMostChannels = 64;
constexpr double kMostSeconds = 9e9;  // longer times do not fit into nanoseconds

constexpr EnumNames<PageMessage::Type, 10> kTypes{
    "type", {"", "hello", "want", "bins", "rows", "open", "command", "stop", "shown", "ping"}};
constexpr EnumNames<PageWants, 3> kWants{"data", {"none", "state", "samples"}};

/// Reads the keys of one message. ok() is false after a value of a wrong type.
class Keys {
 public:
  explicit Keys(const nlohmann::json& object) : object_(object) {}

  [[nodiscard]] bool ok() const noexcept { return ok_; }

  void read(const char* key, double& value) {
    const nlohmann::json* found = find(key);
    if (found == nullptr) return;
    const double number = found->is_number() ? found->get<double>() : kMostSeconds * 2;
    if (std::abs(number) <= kMostSeconds)  // false for NaN
      value = number;
    else
      ok_ = false;
  }

  template <class Integer>
  void read(const char* key, Integer& value) {
    double number = static_cast<double>(value);
    read(key, number);
    if (number >= 0 && number <= static_cast<double>(std::min<std::uint64_t>(std::numeric_limits<Integer>::max(),
                                                                             std::uint64_t{1} << 53U)))
      value = static_cast<Integer>(number);
    else
      ok_ = false;
  }

  void read(const char* key, std::string& value) {
    const nlohmann::json* found = find(key);
    if (found == nullptr) return;
    if (found->is_string())
      value = found->get<std::string>();
    else
      ok_ = false;
  }

  void read(const char* key, std::vector<std::string>& values) {
    const nlohmann::json* found = find(key);
    if (found == nullptr) return;
    ok_ = ok_ && found->is_array() && found->size() <= kMostChannels;
    for (std::size_t i = 0; ok_ && i < found->size(); ++i) {
      ok_ = (*found)[i].is_string();
      if (ok_) values.push_back((*found)[i].get<std::string>());
    }
  }

  [[nodiscard]] bool has(const char* key) const { return find(key) != nullptr; }

 private:
  [[nodiscard]] const nlohmann::json* find(const char* key) const {
    const auto found = object_.find(key);
    return found == object_.end() || found->is_null() ? nullptr : &*found;
  }

  const nlohmann::json& object_;
  bool ok_ = true;
};

template <class Enum, std::size_t n>
Enum known_or(const EnumNames<Enum, n>& names, const std::string& text, Enum fallback) {
  const auto found =
      std::find_if(names.names.begin(), names.names.end(), [&](const char* name) { return text == name; });
  return found == names.names.end() ? fallback : static_cast<Enum>(found - names.names.begin());
}

}  // namespace

std::optional<PageMessage> parse_page_message(std::string_view text) {
  const nlohmann::json json = nlohmann::json::parse(text, nullptr, false);
  if (!json.is_object()) return std::nullopt;
  Keys keys(json);
  PageMessage message;
  std::string type, data;
  keys.read("type", type);
  message.type = known_or(kTypes, type, PageMessage::Type::unknown);
  if (!keys.has("type") || !keys.ok()) return std::nullopt;
  // A stop is obeyed whatever else the message says.
  if (message.type == PageMessage::Type::unknown || message.type == PageMessage::Type::stop) return message;

  keys.read("id", message.id);
  keys.read("version", message.version);
  keys.read("pixels", message.pixels);
  keys.read("recording", message.index);
  keys.read("frame", message.frame);
  keys.read("trial", message.trial);
  keys.read("t0", message.t0);
  keys.read("t1", message.t1);
  keys.read("time", message.time);
  keys.read("sent", message.sent);
  keys.read("token", message.token);
  keys.read("line", message.line);
  keys.read("what", message.what);
  keys.read("data", data);
  keys.read("channels", message.channels);
  message.wants = known_or(kWants, data, PageWants::none);
  if (keys.has("last")) {
    double last = 0;
    keys.read("last", last);
    message.last = last;
  }
  if (!keys.ok()) return std::nullopt;
  return message;
}

}  // namespace haptrace
